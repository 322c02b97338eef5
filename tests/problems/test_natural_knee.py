"""The natural knee, whose tibia is convex: poses without shear."""

from pathlib import Path

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.scenes.load_cycle import read_cycle
from casadi_contact.scenes.walking import reference_cycle
from tests.support import meshes  # noqa: F401  (skips without the extra `mesh`)
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file


@pytest.fixture(scope="module")
def model():
    shared_file("data/jam/femur_cartilage.obj")
    scene = cc.load_scene(Path(__file__).parents[2] / "problems" / "scenes" / "natural_knee.toml")
    return CellFoundation(scene, Cells(1.7, 1.7, 4, 4))


@needs_compiler
def test_a_convex_tibia_has_poses_without_shear_and_they_do_not_leap(model):
    walk = reference_cycle()
    ry, rz = walk.ry[:10], walk.rz[:10]
    poses = shear_free_poses(model, ry, rz)
    by_name = dict(zip(model.load_names, model(poses).T, strict=True))
    for name, wanted in (("Fy_med", -500.0), ("Fy_lat", -500.0), ("Fx", 0.0), ("Fz", 0.0)):
        np.testing.assert_allclose(by_name[name], wanted, atol=0.2)
    np.testing.assert_array_equal(poses[:, 4:], np.column_stack([ry, rz]))
    assert np.abs(np.diff(poses[:, :3], axis=0)).max() < 2.5, "another of several places, from frame to frame"


@needs_compiler
def test_a_femur_without_a_place_free_of_shear_stands_where_it_is_least_and_is_told(model):
    """Turned outwards by 5 degrees: beside these places no step of 0.3 mm along x or z lessens the shear."""
    walk = read_cycle(shared_file("data/jw/og4_loads.csv"))
    frames = slice(34, 42)
    with pytest.warns(RuntimeWarning, match="shear"):
        poses = shear_free_poses(model, walk.ry[frames], walk.rz[frames])

    def shear(at):
        loads = dict(zip(model.load_names, model(at).T, strict=True))
        np.testing.assert_allclose(np.array([loads["Fy_med"], loads["Fy_lat"]]), -500.0, atol=2.0)
        return np.hypot(loads["Fx"], loads["Fz"])

    least = shear(poses)
    left = np.flatnonzero(least > 0.2)
    assert 0 < len(left) < 8
    assert least.max() < 50.0
    sides = dict.fromkeys(("Fy_med", "Fy_lat"), -500.0)
    for column in (0, 2):
        for step in (-0.3, 0.3):
            moved = poses[left].copy()
            moved[:, column] += step
            beside, report = cc.settle(model, moved, ("ty", "rx"), sides, tolerance=0.1)
            assert report.converged.all()
            assert (shear(beside) > least[left] - 0.2).all()
    with pytest.raises(ValueError, match="shear"):
        shear_free_poses(model, np.zeros(2), np.full(2, -3.0))  # 172 degrees of flexion: nothing of the femur is there
