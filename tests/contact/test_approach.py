"""The first touch: the body meets the other one, and neither overlaps it nor stops before."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import casadi_contact as cc
from casadi_contact.contact.approach import advance_to_contact, first_crossing


def test_a_sphere_touches_a_plane_at_its_radius():
    model = cc.PolarFoundation(cc.load_scene("sphere_on_plane"), compiled=False)
    poses = np.zeros((3, 6))
    poses[:, 0] = [0.0, 1.0, -2.0]
    touching = advance_to_contact(model, poses, {})
    np.testing.assert_allclose(touching[:, 1], model.scene.geometry["radius"], atol=2e-3)
    np.testing.assert_array_equal(touching[:, [0, 2, 3, 4, 5]], poses[:, [0, 2, 3, 4, 5]])


def test_a_ball_in_a_cup_touches_it_where_the_wanted_force_points():
    model = cc.CupFoundation(cc.load_scene("hip"), compiled=False)
    scene = model.scene
    force = {"Fx": np.array([100.0]), "Fy": np.array([900.0]), "Fz": np.array([200.0])}
    start = scene.start_pose[None]
    moved = advance_to_contact(model, start, force)[0, :3] - scene.start_pose[:3]
    along = np.concatenate(list(force.values()))
    clearance = scene.geometry["cup_radius"] - scene.geometry["ball_radius"]
    np.testing.assert_allclose(moved, clearance * along / np.linalg.norm(along), atol=3e-3)
    with pytest.raises(ValueError, match="no load Fx"):
        advance_to_contact(model, start, {})


@pytest.mark.parametrize("name", ["knee", "sphere_in_dish", "patellofemoral", "glenohumeral"])
def test_the_example_of_a_foundation_overlaps_as_a_joint_does(name):
    """Start poses are often zero, where bodies lie deep in one another: an example from there says 10⁸ N."""
    kind = cc.CupFoundation if name == "glenohumeral" else cc.PolarFoundation
    model = kind(cc.load_scene(name), compiled=False)
    pose = model.example_pose()
    assert -0.11 < model.gaps(pose).min() < -0.05  # mm
    assert 50.0 < np.linalg.norm(model.wrenches(pose)[0, :3]) < 5000.0


REACH = 15.0


@given(st.lists(st.floats(0.0, 2.0 * REACH), max_size=6), st.floats(0.05, 4.0))
def test_what_holds_from_a_place_on_is_found_there(begins, step):
    begins = np.array(begins)
    ways = first_crossing(lambda which, way: way >= begins[which], len(begins), step, REACH)
    missed = ways - np.minimum(begins, REACH)
    assert (missed >= 0.0).all()
    assert (missed <= step / 2**11).all()
