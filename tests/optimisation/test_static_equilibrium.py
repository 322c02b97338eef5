"""Static equilibrium: balance along every free direction, far starts, loads that nothing carries."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cup import CupFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, angular_velocity_map, pose_index
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.optimisation.starts import middle_pose
from casadi_contact.optimisation.static_equilibrium import SOFT_TISSUE, StaticEquilibrium
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import scene_held

LOADS = np.array([-100.0, -1500.0, 0.0, 7500.0, -2000.0, 0.0])
REST = np.zeros((3, 6))
REST[:, 1], REST[:, 5] = 27.5, -np.radians([5.0, 30.0, 75.0])


@pytest.fixture(scope="module")
def solved(knee):
    problem = StaticEquilibrium(knee, np.tile(LOADS, (3, 1)), rest=REST, about="moving")
    return problem, problem.solve()


def test_contact_carries_the_given_loads_along_every_free_direction(knee, solved):
    _, result = solved
    assert result.solved.all()
    for pose, wrench in zip(result.poses, result.wrenches, strict=True):
        # About the moving origin, by a plain cross product; the rest is the torque that the lock of rz gives.
        torque = wrench[3:] - np.cross(pose[:3], wrench[:3])
        left = angular_velocity_map(pose[3:]).T @ (torque - LOADS[3:])
        np.testing.assert_allclose(wrench[:3], LOADS[:3], atol=1e-4)
        np.testing.assert_allclose(left[:2], 0.0, atol=1e-2)
    about_fixed = np.tile(LOADS, (3, 1))
    about_fixed[:, 3:] += np.cross(result.poses[:, :3], about_fixed[:, :3])
    again = StaticEquilibrium(knee, about_fixed, rest=REST).solve()
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-4)


def test_six_free_parameters_share_the_loads_with_the_springs(knee):
    problem = StaticEquilibrium(
        knee, np.tile(LOADS, (3, 1)), free=POSE_NAMES, rest=REST, stiffness=SOFT_TISSUE, about="moving"
    )
    result = problem.solve()
    assert result.solved.all()
    springs = problem.stiffness * (result.poses - REST)
    np.testing.assert_allclose(result.wrenches[:, :3] + springs[:, :3], np.tile(LOADS[:3], (3, 1)), atol=0.1)
    assert np.abs(np.degrees(result.poses[:, 5] - REST[:, 5])).max() > 0.05  # flexion moved, held by its spring


@pytest.mark.parametrize("lift_mm", [2.0, 20.0, -5.0])
def test_starts_far_out_of_contact_and_too_deep_reach_the_same_pose(solved, lift_mm):
    problem, result = solved
    moves = np.random.default_rng(7).uniform(-1.0, 1.0, (3, 6)) * [4.0, 0.0, 1.0, 0.05, 0.1, 0.0]
    moves[:, 1] = lift_mm
    np.testing.assert_allclose(problem.solve(result.poses + moves).poses, result.poses, atol=1e-4)


def test_rows_that_nothing_carries_are_reported_and_leave_the_others_alone(knee, solved):
    loads = np.tile(LOADS, (3, 1))
    loads[0, WRENCH_NAMES.index("Fy")] = 50.0  # pulls
    loads[1, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    problem = StaticEquilibrium(knee, loads, rest=REST, about="moving")
    assert problem.pulls.tolist() == [True, False, False]
    result = problem.solve(restarts=1)
    assert result.solved.tolist() == [False, False, True]
    np.testing.assert_allclose(result.poses[2], solved[1].poses[2], atol=1e-6)


def test_rows_left_unsolved_begin_again_beside_solved_ones(solved):
    problem, result = solved
    stopped = problem.solve(max_iterations=9)
    again = problem.solve(max_iterations=40, restarts=2)
    assert stopped.solved.sum() < 3
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-6)


@pytest.mark.parametrize("force_n", [5.0, 1500.0])
def test_light_and_heavy_loads_are_balanced_to_the_same_share(knee, force_n):
    loads = force_n * np.array([-0.02, -1.0, 0.0, 5.0, 0.0, 0.0])
    problem = StaticEquilibrium(knee, loads, rest=[0.0, 27.5, 0.0, 0.0, 0.0, -0.5], about="moving")
    assert problem.tolerance_n[0] == pytest.approx(1e-4 * force_n, rel=0.01)
    np.testing.assert_allclose(problem.solve().wrenches[0, :3], loads[:3], atol=1e-4 * force_n)


@needs_compiler
def test_a_ball_carries_no_torque_about_its_centre_but_a_spring_does():
    model, loads = cc.foundation("sphere_in_dish"), [20.0, -200.0, 0.0, 1000.0, 0.0, 0.0]
    assert not StaticEquilibrium(model, loads, about="moving").solve().solved.any()
    sprung = StaticEquilibrium(model, loads, stiffness={"rx": 5e3}, about="moving")
    result = sprung.solve()
    assert result.solved.all()
    assert result.poses[0, 3] - sprung.rest[0, 3] == pytest.approx(1000.0 / 5e3, rel=1e-3)


@needs_compiler
@pytest.mark.parametrize(
    ("model", "free", "loads"),
    [
        (
            lambda: PolarFoundation(whole_wrench(cc.load_scene("planar_knee")), Rays(8, 2)),
            "tx ty",
            (-60, -1200, 0, 7500),
        ),
        (lambda: CupFoundation(cc.load_scene("hip")), "tx ty tz", (100, 900, -150, 0)),
    ],
    ids=["planar knee", "hip"],
)
def test_other_joints_settle_from_out_of_contact(model, free, loads):
    model, free = model(), free.split()
    apart = middle_pose(model) + 0.1 * np.isin(POSE_NAMES, free[-1:])
    assert not model(apart[None]).any()
    result = StaticEquilibrium(model, [*loads, 0.0, 0.0], free=free).solve(apart[None])
    columns = [pose_index(name) for name in free]
    np.testing.assert_allclose(result.wrenches[0, columns], np.array(loads)[columns], atol=0.1)


@needs_compiler
def test_a_virtual_move_along_a_tie_does_no_work():
    """tx with 0.01 rad/mm of ry: neither force alone vanishes."""
    tie = {"locked": {"tz": 0.3}, "tied": {"ry": {"to": "tx", "slope": 0.01, "at_zero": -0.02}}}
    knee = PolarFoundation(scene_held("knee", tie), Rays(8, 2))
    loads = np.array([-20.0, -800.0, 0.0, 3000.0, -3000.0, 0.0])
    rest = knee.scene.pose_space.project(np.array([0.0, 27.5, 0.0, 0.0, 0.0, -0.3]))
    result = StaticEquilibrium(knee, loads, free=("tx", "ty", "rx"), rest=rest).solve()
    assert result.solved.all()
    left = loads - result.wrenches[0]
    torque, rx = left[3:] - np.cross(result.poses[0, :3], left[:3]), result.poses[0, 3]
    by_tx, by_ry = left[0], 0.01 * torque @ np.array([0.0, np.cos(rx), np.sin(rx)])
    assert by_tx + by_ry == pytest.approx(0.0, abs=0.01)
    assert abs(by_tx) > 10.0


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"loads": np.zeros((2, 5))}, "shape"),
        ({"free": ("tx", "tx")}, "once"),
        ({"free": POSE_NAMES}, "spring"),
        ({"stiffness": {"tx": -1.0}}, "stiffness"),
        ({"rest": np.zeros((2, 6))}, "rest"),
        ({"about": "middle"}, "about"),
    ],
)
def test_wrong_requests_are_refused(knee, given, word):
    with pytest.raises(ValueError, match=word):
        StaticEquilibrium(knee, **{"loads": LOADS, **given})
