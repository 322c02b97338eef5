"""What a scene locks or ties holds in every static analysis, on a contact model that knows nothing of it.

A frictionless ball in a spherical dish is pressed along the line of both centres: F ~ (tx, ty - 45, tz).
"""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.approach import advance_to_contact
from casadi_contact.core.conventions import pose_index
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.joint_cycle import JointCycle
from tests.support.ready_poses import AT_ZERO, LOCKED, SLOPE, held_ball

DISH_MM = 45.0
TARGET = {"Fy": np.array([-300.0, -500.0]), "Fx": np.array([-20.0, 30.0])}
OFF = np.array([[0.3, 31.0, 1.5, 0.2, 0.0, 0.1], [0.0, 29.8, 0.0, 0.0, 0.1, 0.0]])  # off the tie and the locks


@pytest.fixture(scope="module")
def ball():
    return cc.ElasticFoundation(held_ball(), (120, 120))


def is_held(poses):
    np.testing.assert_allclose(poses[..., pose_index("tz")], AT_ZERO + SLOPE * poses[..., 0], atol=1e-12)
    np.testing.assert_array_equal(poses[..., pose_index("rx")], LOCKED)
    np.testing.assert_array_equal(poses[..., pose_index("ry")], 0.0)


def test_settled_poses_lie_on_the_tie_and_carry_the_loads_there(ball):
    poses, report = cc.settle(ball, OFF, ("tx", "ty"), TARGET)
    assert report.converged.all(), report.reason
    is_held(poses)
    np.testing.assert_array_equal(poses[:, 5], OFF[:, 5])
    loads = ball(poses)
    np.testing.assert_allclose(loads[:, 0], TARGET["Fx"], atol=1e-4)
    tx, ty, tz = poses[:, :3].T
    np.testing.assert_allclose(tx / (ty - DISH_MM), TARGET["Fx"] / TARGET["Fy"], rtol=0.02)
    np.testing.assert_allclose(loads[:, 2] / loads[:, 0], tz / tx, rtol=0.02)


def test_damped_motion_comes_to_rest_in_the_same_poses(ball):
    ball, target = cc.ElasticFoundation(ball.scene, (40, 40)), {name: loads[:1] for name, loads in TARGET.items()}
    poses, _ = cc.settle(ball, OFF[:1], ("tx", "ty"), target)
    rested, report = cc.relax(ball, poses + np.array([0.1, 0.02, 0.3, 0.1, 0.0, 0.0]), ("tx", "ty"), target)
    assert report.converged.all(), report.reason
    is_held(rested)
    np.testing.assert_allclose(rested, poses, atol=1e-5)


@pytest.mark.parametrize("find", [cc.settle, cc.relax])
@pytest.mark.parametrize(
    ("free", "said"), [("rx", "rx is locked at 0.05 by the scene"), ("tz", "tz is tied to tx by the scene")]
)
def test_what_is_held_is_refused_as_free(ball, find, free, said):
    with pytest.raises(ValueError, match=said):
        find(ball, OFF, ("ty", free), TARGET)


def test_a_reference_motion_is_one_that_the_joint_can_make(ball):
    """Where tx is found from loads, and against what was measured of rx."""
    pose = {"rz": np.zeros(3), "rx": np.full(3, 0.2)}
    cycle = JointCycle("run", np.arange(3.0), pose, {"Fy": np.full(3, -300.0), "Fx": np.array([-20.0, 0.0, 20.0])})
    poses, report = reference_poses(ball, [cycle], frames=5)
    assert report.converged.all(), report
    is_held(poses[0])
    np.testing.assert_allclose(ball(poses[0])[:, 0], np.linspace(-20.0, 20.0, 5), atol=1e-3)


def test_a_body_touches_first_where_the_joint_lets_it_be(ball):
    poses = advance_to_contact(ball, OFF, {})
    is_held(poses)
    assert np.abs(ball.gaps(poses)).max() < 2e-3
