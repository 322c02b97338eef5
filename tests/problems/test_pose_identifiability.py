"""Loads that do not tell a pose: on a plane forces are the same everywhere, in a dish they turn with the place."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.scenes.joint_cycle import JointCycle
from problems import pose_estimation
from problems.pose_estimation.estimate import estimated
from problems.pose_estimation.identifiability import (
    hardly_determined,
    hardly_determined_frames,
    hardly_determined_in_words,
)
from problems.pose_estimation.report import report
from tests.support.compiler import needs_compiler

POSES = np.array([[0.0, 29.9, 0.0, 0.0, 0.1, 0.2], [2.0, 29.8, -1.0, 0.1, 0.0, 0.0]])
FORCES, ALL = ("Fx", "Fy", "Fz"), ("Fx", "Fy", "Fz", "Tx", "Tz")


def problem_of(scene, names, poses):
    model = PolarFoundation(cc.load_scene(scene), Rays(16, 3))
    loads = dict(zip(names, model(poses, names).T, strict=True))
    pose = {name: poses[:, 3 + k] for k, name in enumerate(("rx", "ry", "rz"))}
    return pose_estimation.build(model, JointCycle("cycle", np.array([0.0, 1.0]), pose, loads))


@needs_compiler
@pytest.mark.parametrize(("names", "told"), [(FORCES, False), (ALL, True)])
def test_forces_do_not_tell_where_on_a_plane_a_ball_lies_and_torques_do(names, told):
    problem = problem_of("sphere_on_plane", names, POSES)
    found, along = hardly_determined(problem, POSES)
    np.testing.assert_array_equal(found, not told)
    if not told:
        assert np.abs(along[:, 1]).max() < 0.01  # never into the plane


@needs_compiler
def test_forces_tell_where_in_a_dish_a_ball_lies():
    scene = cc.load_scene("sphere_in_dish")
    poses = np.array([scene.start_pose, scene.start_pose]) - [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    problem = problem_of("sphere_in_dish", FORCES, poses)
    assert not hardly_determined(problem, poses)[0].any()
    assert hardly_determined_in_words(problem, *hardly_determined_frames(problem, poses, np.ones(2, dtype=bool))) == ""


@needs_compiler
def test_a_side_that_carries_nothing_may_lift_off_as_far_as_it_likes():
    """The way along which loads stay is curved, and begins where the side just touches: no straight step finds it."""
    knee = PolarFoundation(cc.load_scene("knee"), Rays(12, 3))
    both = np.tile([0.7, 27.3, 0.1, 0.002, -0.04, -0.5], (2, 1))
    wanted = {"Fy_med": np.array([-900.0, -600.0]), "Fy_lat": np.array([0.0, -500.0])}
    poses, report = cc.settle(knee, both, ("ty", "rx"), wanted)
    assert report.converged.all()
    free = ("tx", "ty", "tz", "rx")
    pose = {name: poses[:, 3 + k] for k, name in enumerate(("rx", "ry", "rz")) if name not in free}
    names = ("Fy_med", "Fy_lat", "Tx", "Tz")
    cycle = JointCycle("cycle", np.array([0.0, 1.0]), pose, dict(zip(names, knee(poses, names).T, strict=True)))
    problem = pose_estimation.build(knee, cycle)
    assert hardly_determined(problem, poses)[0].tolist() == [True, False]


@needs_compiler
def test_only_frames_that_are_solved_are_named():
    problem = problem_of("sphere_on_plane", FORCES, POSES)
    frames, along = hardly_determined_frames(problem, POSES, np.array([False, True]))
    said = hardly_determined_in_words(problem, frames, along)
    assert "in 1 of 2 frames" in said
    assert said.endswith("frames 1")


@needs_compiler
def test_the_report_tells_beside_its_verdict_that_a_verified_pose_is_one_of_many(tmp_path, capsys):
    problem = problem_of("sphere_on_plane", FORCES, POSES)
    model = own_model(problem.model.scene)
    report(problem, estimated(problem, None, model), tmp_path, "foundation")
    said = " ".join(capsys.readouterr().out.split())
    assert "2 of 2 solved and verified" in said
    assert "the wanted loads hardly tell the pose in 2 of 2 frames: 1 mm away" in said
