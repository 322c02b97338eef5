"""What a scene locks or ties holds in optimisation problems: variables are the free parameters alone."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.optimisation.starts import middle_pose
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import AT_ZERO, LOCKED, SLOPE, held_ball, scene_held

TARGET = {"Fy": -300.0, "Fx": -20.0}


@pytest.fixture(scope="module")
def ball():
    return symbolic(cc.ElasticFoundation(held_ball(), (60, 60)))


def test_poses_of_a_problem_are_those_that_the_joint_can_take(ball):
    frames = cc.ContactFrames(ball, 2)
    assert frames.free == ("tx", "ty", "rz")
    assert cc.ContactFrames(ball, locked={"rx": LOCKED, "rz": 0.1, "tx": 0.4, "tz": 0.4}).free == ("ty",)
    pose = ca.Function("pose", [frames.q], [frames.pose])
    values = np.random.default_rng(0).normal(size=(3, 2)) + 0.5 * (frames.lower + frames.upper).reshape(2, 3).T
    poses = pose(values).full().T
    np.testing.assert_allclose(poses[:, 2], AT_ZERO + SLOPE * poses[:, 0])
    np.testing.assert_array_equal(poses[:, 3:5], np.tile([LOCKED, 0.0], (2, 1)))
    np.testing.assert_allclose(frames.poses_with(np.zeros((2, 6)), values.T), poses)
    np.testing.assert_allclose(frames.variables(poses), values.T.ravel())
    for start in (middle_pose(ball), frames.start_poses({"Fy": [-300.0, -5.0]})):
        np.testing.assert_allclose(start, ball.scene.pose_space.project(start), atol=1e-12)


def test_a_tied_contact_in_opti_carries_its_loads_on_the_tie(ball):
    opti = ca.Opti()
    contact = cc.ContactInOpti(opti, ball, locked={"rz": 0.1})
    contact.carry(TARGET)
    opti.minimize(0)
    opti.solver("ipopt", contact.options())
    (pose,) = contact.poses(opti.solve())
    assert pose[2] == pytest.approx(AT_ZERO + SLOPE * pose[0])
    np.testing.assert_allclose(ball(pose[None], tuple(TARGET))[0], list(TARGET.values()), atol=1e-3)
    settled, _ = cc.settle(ball, pose[None], ("tx", "ty"), TARGET)
    np.testing.assert_allclose(settled[0], pose, atol=1e-6)


@pytest.mark.parametrize(
    ("locked", "said"),
    [
        ({"rx": 0.1}, "rx"),
        ({"tx": 0.4, "tz": 0.0}, "tied"),
        ({"tz": 0.4}, "tied"),
        ({"ry": ca.MX.sym("ry")}, "expression"),
        ({"rz": -30.0}, "degrees"),
    ],
)
def test_locks_of_a_problem_that_contradict_the_scene_are_refused(ball, locked, said):
    with pytest.raises(ValueError, match=said):
        cc.ContactFrames(ball, locked=locked)


@needs_compiler
def test_what_needs_all_six_says_which_are_held():
    knee = PolarFoundation(scene_held("knee", {"locked": {"tz": 0.0}}), Rays(8, 2))
    with pytest.raises(ValueError, match="all six"):
        shear_free_poses(knee, np.zeros(1), np.zeros(1))
