"""CalculiX as a user's own solver: its forces are those of the library's finite elements."""

import shutil

import numpy as np
import pytest

import casadi_contact as cc
from problems import own_solver


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_calculix_and_finite_elements_agree_on_a_sphere(tmp_path):
    (tmp_path / "block.toml").write_text(own_solver.SCENE)
    scene, poses = cc.load_scene(tmp_path / "block.toml"), np.zeros((3, 6))
    poses[:, :2] = [[0.0, 29.7], [-2.0, 29.8], [0.0, 30.01]]
    found = own_solver.solved(scene, poses, tmp_path)
    wanted = cc.FiniteElements(scene.with_overrides(patch_side=25.0), (25, 25)).wrenches(poses)[:, 0]
    np.testing.assert_allclose(found[:, 1], wanted[:, 1], rtol=0.04)
    assert found[1, 5] == pytest.approx(wanted[1, 5], rel=0.15)


def test_without_calculix_a_line_says_so(monkeypatch, capsys):
    monkeypatch.setattr(own_solver.shutil, "which", lambda name: None)
    own_solver.main()
    assert "calculix-ccx" in capsys.readouterr().out
