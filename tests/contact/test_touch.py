"""The first touch: the body meets the other one, and neither overlaps it nor stops before."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import CupFoundation, PolarFoundation
from casadi_contact.contact.touch import first_touch


def test_a_sphere_touches_a_plane_at_its_radius():
    model = PolarFoundation(cc.load_scene("sphere_on_plane"), compiled=False)
    poses = np.zeros((3, 6))
    poses[:, 0] = [0.0, 1.0, -2.0]
    touching = first_touch(model, poses, {})
    np.testing.assert_allclose(touching[:, 1], model.scene.geometry["radius"], atol=2e-3)
    np.testing.assert_array_equal(touching[:, [0, 2, 3, 4, 5]], poses[:, [0, 2, 3, 4, 5]])


def test_a_ball_in_a_cup_touches_it_where_the_wanted_force_points():
    model = CupFoundation(cc.load_scene("hip"), compiled=False)
    scene = model.scene
    force = {"Fx": np.array([100.0]), "Fy": np.array([900.0]), "Fz": np.array([200.0])}
    start = scene.start_pose[None]
    moved = first_touch(model, start, force)[0, :3] - scene.start_pose[:3]
    along = np.concatenate(list(force.values()))
    clearance = scene.geometry["cup_radius"] - scene.geometry["ball_radius"]
    np.testing.assert_allclose(moved, clearance * along / np.linalg.norm(along), atol=3e-3)
    with pytest.raises(ValueError, match="there is no load Fx, Fy, Fz, expected the force that presses"):
        first_touch(model, start, {})


@pytest.mark.parametrize("name", ["knee", "sphere_in_dish", "patellofemoral", "glenohumeral"])
def test_the_example_of_a_foundation_overlaps_as_a_joint_does(name):
    """Start poses are often zero, where bodies lie deep in one another: an example from there says 10⁸ N."""
    kind = CupFoundation if name == "glenohumeral" else PolarFoundation
    model = kind(cc.load_scene(name), compiled=False)
    pose = model.example_pose()
    assert -0.11 < model.gaps(pose).min() < -0.05  # mm
    assert 50.0 < np.linalg.norm(model.wrenches(pose)[0, :3]) < 5000.0


def test_the_example_of_a_ball_that_no_direction_presses_is_the_start_pose():
    model = CupFoundation(cc.load_scene("hip"), compiled=False)
    assert model.example_pose() == model.scene.start_pose.tolist()
