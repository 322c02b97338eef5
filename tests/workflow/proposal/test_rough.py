"""A rough fixed surface carries too much, and is told; a smooth one of the same shape is not."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.workflow.proposal.damage import rough
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, write_obj

OVERLAP_MM, RADIUS_MM = 0.1, 20.0
EXACT_N = np.pi * 267.5728 * OVERLAP_MM**2 * (RADIUS_MM - OVERLAP_MM / 3.0)


@pytest.mark.parametrize(("noise_mm", "edge_mm", "told"), [(0.0, 0.06, False), (0.02, 0.3, False), (0.02, 0.06, True)])
def test_noise_that_is_steep_between_short_edges_is_told(tmp_path, noise_mm, edge_mm, told):
    """The same noise between edges five times as long is a fifth as steep: the cure that is named."""
    points, faces = sheet_mesh(6.0, edge_mm)
    points[:, 1] += noise_mm * np.random.default_rng(1).standard_normal(len(points))
    write_obj(tmp_path / "ball.obj", *cap_mesh(RADIUS_MM, 1.0, 0.2))
    write_obj(tmp_path / "plate.obj", points, faces)
    (tmp_path / "scene.toml").write_text(mesh_scene_text("ball.obj", "plate.obj", grid=(160, 160)))
    scene = cc.load_scene(tmp_path / "scene.toml")
    pose = np.array([0.0, RADIUS_MM - OVERLAP_MM, 0.0, 0.0, 0.0, 0.0])
    load = -cc.ElasticFoundation(scene).wrenches(pose)[0, 1] / EXACT_N
    assert load == pytest.approx(1.14 if told else 1.0, abs=0.04)
    assert bool(rough(load_mesh(tmp_path / "plate.obj", "mm"))) == told
