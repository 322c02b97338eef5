"""Static analyses [EF15 §2.4], by Newton and by damped motion: found from far away, held by joints, reported."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.approach import advance_to_contact
from casadi_contact.contact.settle import NOT_FINITE
from casadi_contact.core.conventions import LEVER_MM, pose_index
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.loading import scene_from_text
from tests.support import two_spheres
from tests.support.ready_poses import AT_ZERO, LOCKED, SLOPE, at, held_ball, walking
from tests.support.two_spheres import TwoSpheres

PRESSED = ("ty",), {"Fy_med": -400.0}


@pytest.fixture(scope="module")
def knee():
    return cc.ElasticFoundation(cc.load_scene("knee"), (40, 20))


@pytest.mark.parametrize("lift_mm", [-2.0, 0.5, 3.0, 10.0])
def test_wanted_forces_are_found_from_out_of_contact_and_from_too_deep(knee, lift_mm):
    poses, targets = walking(60)
    poses[:, 1] += lift_mm
    settled, report = cc.settle(knee, poses, free=("ty", "rx"), targets=targets)
    assert report.converged.all(), report.reason
    np.testing.assert_allclose(knee(settled)[:, :2], np.column_stack(list(targets.values())), atol=1e-4)
    locked = [0, 2, 4, 5]
    np.testing.assert_array_equal(settled[:, locked], poses[:, locked])


def test_two_mm_and_five_degrees_off_four_free_parameters_come_back(knee):
    """Too deep by 2 mm a knee carries tens of thousands of newtons, whose torques would lead astray."""
    poses, targets = walking(60)
    truth, _ = cc.settle(knee, poses, ("ty", "rx"), targets)
    wanted = dict(zip(("Fy_med", "Fy_lat", "Tx", "Tz"), knee(truth)[:, [0, 1, 4, 6]].T, strict=True))
    off = np.random.default_rng(5).uniform(-1.0, 1.0, (60, 4)) * [2.0, 2.0, 2.0, np.radians(5.0)]
    start = truth + np.pad(off, ((0, 0), (0, 2)))
    found, report = cc.settle(knee, start, ("tx", "ty", "tz", "rx"), wanted)
    assert report.converged.all(), report.reason
    np.testing.assert_allclose(found, truth, atol=1e-3)


class WavySpheres(TwoSpheres):
    """Centres of pressure that go to and fro, as those on a mesh do: x + 0.06·sin(20·x)."""

    def _centres(self, poses):
        centres, slopes = super()._centres(poses)
        x = centres[..., 0].copy()
        centres[..., 0] += 0.06 * np.sin(20.0 * x)
        slopes[..., 0, :] *= 1.0 + 1.2 * np.cos(20.0 * x)[..., None]
        return centres, slopes


def test_torques_that_rise_and_fall_on_the_way_are_met_all_the_same():
    model, rng = WavySpheres(two_spheres.knee()), np.random.default_rng(2)
    truth = np.repeat(at(26.94), 60, axis=0)
    truth[:, 0] = rng.uniform(-3.0, 3.0, 60)
    wanted = dict(zip(("Fy_med", "Fy_lat", "Tx", "Tz"), model(truth)[:, [0, 1, 4, 6]].T, strict=True))
    start = truth + np.pad(rng.uniform(-1.0, 1.0, (60, 4)) * [1.0, 0.5, 1.0, 0.01], ((0, 0), (0, 2)))
    found, report = cc.settle(model, start, ("tx", "ty", "tz", "rx"), wanted)
    assert report.converged.all(), report.reason
    np.testing.assert_allclose(model(found), model(truth), atol=1e-3)


def test_a_pulling_target_is_reported_not_hidden(knee):
    poses, targets = walking(4)
    targets["Fy_lat"][2] = 50.0
    _, report = cc.settle(knee, poses, ("ty", "rx"), targets)
    assert report.converged.tolist() == [True, True, False, True]
    assert report.reason[2].startswith("no equilibrium: a target load pulls")
    assert report.residual[2] > 1.0
    assert "3 of 4" in str(report)


def test_a_torque_counts_as_the_force_that_makes_it_at_a_condyles_distance(knee):
    """A misfit of 250 N·mm is one of 10 N: 25 mm are about what a condyle lies off the middle."""
    assert np.abs(knee.scene.anchors_mm[:, 2]) == pytest.approx(LEVER_MM, rel=0.2)
    poses = settled = at(27.3)
    wanted = dict(zip(knee.load_names, knee(poses)[0], strict=True))
    targets = {"Fy_med": wanted["Fy_med"], "Tz": wanted["Tz"] + 250.0}
    for limit, converged in ((9.9, False), (10.1, True)):
        settled, report = cc.settle(knee, poses, ("ty", "tx"), targets, tolerance=limit, max_iterations=0)
        assert report.residual[0] == pytest.approx(10.0)
        assert report.converged.tolist() == [converged]
    np.testing.assert_array_equal(settled, poses)
    _, moved = cc.settle(knee, poses, ("ty", "tx"), targets, tolerance=0.01)
    assert abs(moved.misfit["Tz"][0]) <= 0.25


def test_contradicting_loads_end_where_squares_with_torques_over_25_mm_are_least():
    model = cc.ElasticFoundation(cc.load_scene("sphere_in_dish"), (60, 60))
    start = at(29.9, tx=0.5)
    wanted = {"Fx": 200.0, "Tz": 9000.0}  # a resultant through the dish's centre has Tz = -45 mm·Fx
    nearest, report = cc.settle(model, start, ("tx",), wanted)
    assert not report.converged[0]
    columns = [model.load_names.index(name) for name in wanted]
    slope = model.jacobian(nearest)[1][0, columns, 0] / (1.0, 25.0)
    misfit = (model(nearest)[0, columns] - list(wanted.values())) / (1.0, 25.0)
    assert np.abs(misfit).min() > 1.0
    assert misfit @ slope == pytest.approx(0.0, abs=1e-4 * np.linalg.norm(misfit) * np.linalg.norm(slope))


def test_a_ball_that_lies_free_in_its_cup_or_beside_it_is_pressed_along_the_wanted_force():
    """Between the walls of a cup no step closes the gap where the force is to be carried."""
    scene = cc.load_scene("hip")
    model = cc.ElasticFoundation(scene, scene.grids["settle"])
    neutral = scene.start_pose[None]
    force = np.array([-150.0, 600.0, 115.0])
    wanted = dict(zip(("Fx", "Fy", "Fz"), force, strict=True))
    (pose,), report = cc.settle(model, neutral, ("tx", "ty", "tz"), wanted)
    assert report.converged.all()
    starts = np.tile(pose, (40, 1))
    starts[:, :3] += np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3)) - 1.0 * force / np.linalg.norm(force)
    found, report = cc.settle(model, starts, ("tx", "ty", "tz"), wanted)
    assert report.converged.all(), set(report.reason)
    np.testing.assert_allclose(found[:, :3], np.tile(pose[:3], (40, 1)), atol=1e-4)


def test_a_body_settles_alike_whichever_loads_are_asked_for():
    """Loads that are balanced need not be among those that a scene asks for: contact does not know of them."""
    scene, wanted = cc.load_scene("hip"), {"Fx": -100.0, "Fy": 1200.0, "Fz": 300.0}
    other = scene_from_text('format = 1\nname = "fewer"\nlike = "hip"\n[loads]\nnames = ["Tx"]\n')
    pose, free = [[69.96, -65.56, -83.89, 0.0, 0.0, 0.0]], ("tx", "ty", "tz")
    (there, first), (same, second) = (
        cc.settle(cc.CupFoundation(s, compiled=False), pose, free, wanted) for s in (scene, other)
    )
    assert first.converged.all()
    assert second.converged.all()
    np.testing.assert_allclose(same, there, rtol=0.0, atol=1e-7)
    with pytest.raises(ValueError, match="unknown target 'Fy', expected one of Fy_med"):
        cc.settle(cc.load_surrogate("knee"), np.zeros((1, 6)), ("ty",), {"Fy": -900.0})  # it has learned no other


def test_damped_dynamics_falls_into_contact():
    model = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20))
    rest, report = cc.relax(model, at(33.0), ("ty",), {"Fy": -400.0})
    assert report.converged[0]
    assert model(rest)[0, 1] == pytest.approx(-400.0, abs=1e-3)


@pytest.mark.parametrize("tolerance_n", [1e-3, 1.0, 30.0])
def test_damped_motion_ends_as_soon_as_the_loads_are_met_within_tolerance(tolerance_n):
    """It creeps towards rest, so that it stops on the bound itself: neither short of it nor well inside."""
    _, report = cc.relax(TwoSpheres(two_spheres.knee()), at(27.0), *PRESSED, damping=100.0, tolerance=tolerance_n)
    assert 0.9 * tolerance_n < report.residual[0] < 1.02 * tolerance_n


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_pose_that_moves_to_where_loads_are_not_finite_ends_at_the_border_and_costs_no_other():
    scene = cc.load_scene("sphere_on_plane")
    elements = cc.ElasticFoundation(scene, (20, 20))

    def fails_deep(poses):
        loads = elements.wrenches(poses)
        loads[poses[:, 1] < 29.95] = np.nan
        return loads

    model = cc.CallableModel(scene, fails_deep, elements.gaps)
    starts = np.vstack([at(height) for height in (30.0, 29.97, 29.9)])
    rest, report = cc.relax(model, starts, ("ty",), {"Fy": [-1000.0, -50.0, -50.0]})
    assert list(report.converged) == [False, True, False]
    assert list(report.reason) == [NOT_FINITE, "", NOT_FINITE]
    np.testing.assert_allclose(rest[0, 1], 29.95, atol=1e-9)
    assert model(rest)[1, 1] == pytest.approx(-50.0, abs=1e-3)
    np.testing.assert_array_equal(rest[2], starts[2])  # never finite: stays
    assert np.isfinite(report.residual[0])  # the loads where it ends, which are the last known


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
    ball, target = cc.ElasticFoundation(ball.scene, (20, 20)), {name: loads[:1] for name, loads in TARGET.items()}
    poses, _ = cc.settle(ball, OFF[:1], ("tx", "ty"), target)
    rested, report = cc.relax(ball, poses + np.array([0.1, 0.02, 0.3, 0.1, 0.0, 0.0]), ("tx", "ty"), target)
    assert report.converged.all(), report.reason
    is_held(rested)
    np.testing.assert_allclose(rested, poses, atol=1e-5)


@pytest.mark.parametrize("find", [cc.settle, cc.relax])
@pytest.mark.parametrize(
    ("free", "targets", "said"),
    [
        (("ty", "rx"), TARGET, "rx is locked at 0.05 by the scene"),
        (("ty", "tz"), TARGET, "tz is tied to tx by the scene"),
        (("ty", "ty"), TARGET, "each named once"),
        (("ty",), {}, "targets is empty"),
        (("ty",), {"Fq": -1.0}, "unknown target 'Fq', expected one of Fx, Fy"),
        (("ty",), {"Fy": np.nan}, "NaN"),
        (("ty",), {"Fy": np.zeros(3)}, r"shape \(3,\), expected a number or \(2,\)"),
    ],
)
def test_bad_requests_are_refused(ball, find, free, targets, said):
    with pytest.raises(ValueError, match=said):
        find(ball, OFF, free, targets)


def test_a_reference_motion_is_one_that_the_joint_can_make(ball):
    """Where tx is found from loads, and against what was measured of rx."""
    pose = {"rz": np.zeros(3), "rx": np.full(3, 0.2)}
    cycle = Cycle("run", np.arange(3.0), pose, {"Fy": np.full(3, -300.0), "Fx": np.array([-20.0, 0.0, 20.0])})
    poses, report = reference_poses(ball, [cycle], frames=5)
    assert report.converged.all(), report
    is_held(poses[0])
    np.testing.assert_allclose(ball(poses[0])[:, 0], np.linspace(-20.0, 20.0, 5), atol=1e-3)


def test_a_body_touches_first_where_the_joint_lets_it_be(ball):
    poses = advance_to_contact(ball, OFF, {})
    is_held(poses)
    assert np.abs(ball.gaps(poses)).max() < 2e-3
