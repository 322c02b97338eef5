"""The natural knee, whose tibia is convex: poses without shear."""

from pathlib import Path

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.optimisation.knee import shear_free_poses
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
    ry, rz = (walk.pose[name][:10] for name in ("ry", "rz"))
    poses = shear_free_poses(model, ry, rz)
    by_name = dict(zip(model.load_names, model(poses).T, strict=True))
    for name, wanted in (("Fy_med", -500.0), ("Fy_lat", -500.0), ("Fx", 0.0), ("Fz", 0.0)):
        np.testing.assert_allclose(by_name[name], wanted, atol=0.2)
    np.testing.assert_array_equal(poses[:, 4:], np.column_stack([ry, rz]))
    assert np.abs(np.diff(poses[:, :3], axis=0)).max() < 2.5, "another of several places, from frame to frame"
    with pytest.raises(ValueError, match="shear"):
        shear_free_poses(model, np.zeros(2), np.full(2, -3.0))  # 172 degrees of flexion: nothing of the femur is there
