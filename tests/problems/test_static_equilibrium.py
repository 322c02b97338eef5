"""Settling under six loads: golden poses, balance, far starts, honest reports, the elastic foundation's own answer."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, angular_velocity_map
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.optimisation.verification.verdict import own_model
from problems import static_equilibrium
from problems.static_equilibrium.balance import Balance
from problems.static_equilibrium.diagnosis import diagnose
from problems.static_equilibrium.pulls import passes_beside, pulls
from problems.static_equilibrium.starts import solve_from_lifts
from tests.support.compiler import needs_compiler

FLEXIONS_DEG = (5.0, 30.0, 75.0)
LOADS = (-100.0, -1500.0, 0.0, 7500.0, -2000.0, 0.0)
SOFT = np.array([static_equilibrium.SOFT_TISSUE[name] for name in POSE_NAMES])


@pytest.fixture(scope="module")
def rest():
    poses = np.zeros((len(FLEXIONS_DEG), 6))
    poses[:, 1], poses[:, 5] = 27.5, -np.radians(FLEXIONS_DEG)
    return poses


@pytest.fixture(scope="module")
def solved(knee, rest):
    problem = static_equilibrium.build(knee, np.tile(LOADS, (len(rest), 1)), rest=rest, about="moving")
    return problem, static_equilibrium.solve(problem)


def test_golden_poses(solved):
    _, result = solved
    assert result.converged.all(), result.reason
    golden = [
        [0.9485, 27.4322, 0.1230, -0.00175, -0.04085],
        [-1.7170, 27.2652, 0.0183, -0.00305, -0.06585],
        [-0.4326, 27.0532, 0.1216, -0.00370, -0.07954],
    ]
    np.testing.assert_allclose(result.poses[:, :5], golden, atol=5e-3)  # by which networks of 0.3 N differ


def test_contact_carries_the_given_loads_along_every_free_direction(solved):
    problem, result = solved
    for pose, wrench in zip(result.poses, result.wrenches, strict=True):
        # About the moving origin, by a plain cross product; the rest is the torque that the lock of rz gives.
        torque = wrench[3:] - np.cross(pose[:3], wrench[:3])
        left = angular_velocity_map(pose[3:]).T @ (torque - problem.loads[0, 3:])
        np.testing.assert_allclose(wrench[:3], problem.loads[0, :3], atol=1e-4)
        np.testing.assert_allclose(left[:2], 0.0, atol=1e-2)


def test_loads_about_the_fixed_origin_give_the_same_pose(knee, rest, solved):
    _, result = solved
    about_fixed = np.tile(LOADS, (len(rest), 1))
    about_fixed[:, 3:] += np.cross(result.poses[:, :3], about_fixed[:, :3])
    again = static_equilibrium.solve(static_equilibrium.build(knee, about_fixed, rest=rest))
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-4)


def test_six_free_parameters_share_the_loads_with_the_springs(knee, rest):
    problem = static_equilibrium.build(
        knee, np.tile(LOADS, (len(rest), 1)), free=POSE_NAMES, rest=rest, stiffness=SOFT, about="moving"
    )
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    springs = SOFT * (result.poses - rest)
    np.testing.assert_allclose(result.wrenches[:, :3] + springs[:, :3], np.tile(LOADS[:3], (3, 1)), atol=0.1)
    assert np.abs(np.degrees(result.poses[:, 5] - rest[:, 5])).max() > 0.05  # flexion moved, held by its spring


def test_starts_far_out_of_contact_and_too_deep_reach_the_same_pose(solved):
    again = solve_from_lifts(*solved, 3, (2.0, 20.0, -5.0))
    assert (again.shares == 1.0).all()
    assert str(again).startswith("3 random starts that end at the same poses, lifted by up to +2 mm: 100.0 %")


def test_the_elastic_foundation_has_its_equilibrium_close_by(knee, solved):
    problem, result = solved
    poses = static_equilibrium.on_model(problem, result, cc.ElasticFoundation(knee.scene, (160, 80)))
    off = np.abs(poses - result.poses).max(axis=0)
    assert off[:3].max() < 0.02
    assert np.degrees(off[3:].max()) < 0.03


def test_another_model_does_not_turn_a_ball_that_nothing_keeps_from_turning():
    model = cc.foundation("hip")
    up = np.array([[-100.0, 1500.0, 400.0, 0.0, 0.0, 0.0]])
    problem = static_equilibrium.build(model, up, rest=[model.scene.start_pose], about="moving")
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    off = np.abs(
        static_equilibrium.on_model(problem, result, cc.ElasticFoundation(model.scene, (60, 60))) - result.poses
    )
    assert off[:, :3].max() < 0.01
    assert np.degrees(off[:, 3:].max()) < 0.01
    assert (solve_from_lifts(problem, result, 3, (2.0, -0.5)).shares == 1.0).all()  # turned, but in the same place


def test_loads_that_nothing_carries_are_named_row_by_row(knee, rest):
    loads = np.tile(LOADS, (3, 1))
    loads[0, WRENCH_NAMES.index("Fy")] = 50.0
    loads[1, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    result = static_equilibrium.solve(static_equilibrium.build(knee, loads, rest=rest, about="moving"))
    assert result.converged.tolist() == [False, False, True]
    assert "does not press the bodies together" in result.reason[0]
    assert "not found in the learned range" in result.reason[1]
    # 60 mm medially of the middle, with the condyles 22 mm to both sides: levers, N_lat·44 = 1500·(22 - 60)
    assert "pass beside both patches, lat would have to pull by 1300 N" in result.reason[1]
    about_fixed = np.array([LOADS])
    about_fixed[0, WRENCH_NAMES.index("Tx")] = 90_000.0
    fixed = static_equilibrium.build(knee, about_fixed, rest=rest[:1], about="fixed")
    assert "lat would have to pull by 1300 N" in passes_beside(fixed, rest[:1])[0]
    sprung = static_equilibrium.build(knee, about_fixed, rest=rest[:1], stiffness=[0.0, 0.0, 0.0, 1e3, 0.0, 0.0])
    assert passes_beside(sprung, rest[:1])[0] == "", "a spring about rx may carry that torque"


def test_rows_left_unsolved_are_sought_from_other_starts_and_impossible_ones_stay_so(knee, rest, solved):
    loads = np.tile(LOADS, (3, 1))
    loads[1, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    problem = static_equilibrium.build(knee, loads, rest=rest, about="moving")
    stopped = static_equilibrium.solve(problem, max_iterations=2)
    assert not stopped.converged.any()
    found = static_equilibrium.search(problem, stopped, 3)
    assert found.converged.tolist() == [True, False, True]
    np.testing.assert_allclose(found.poses[[0, 2]], solved[1].poses[[0, 2]], atol=1e-6)
    np.testing.assert_allclose(found.wrenches[[0, 2], :3], loads[[0, 2], :3], atol=problem.tolerance_n[0])
    assert found.reason[0] == found.reason[2] == ""
    assert found.reason[1].endswith("; not from 3 other starts either")
    assert static_equilibrium.search(problem, stopped, 0).reason[0] == stopped.reason[0]


@needs_compiler
@pytest.mark.parametrize("force_n", [-100.0, 0.0])
def test_a_force_that_presses_no_patch_is_not_sought_for(force_n, monkeypatch):
    """A patella's button presses the groove along +x: no pose pulls it that way. A spring along x might."""
    model = PolarFoundation(whole_wrench(cc.load_scene("patellofemoral")), Rays(4, 1))
    loads = np.array([[force_n, -1500.0, 0.0, 0.0, 0.0, 0.0]])
    sprung = static_equilibrium.build(model, loads, stiffness=[5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert pulls(sprung)[0] == pulls(static_equilibrium.build(model, loads, free=("ty", "tz")))[0] == ""
    monkeypatch.setattr(ca, "nlpsol", lambda *_: pytest.fail("asked IPOPT for what contact never carries"))
    result = static_equilibrium.solve(static_equilibrium.build(model, loads))
    assert not result.converged.any()
    assert result.reason[0].startswith(f"Fx is {force_n:g} N, which does not press the bodies together, expected above")


def test_what_counts_as_balanced_grows_with_the_load_alone(knee):
    loads = np.array([LOADS, np.multiply(LOADS, 1000.0)])
    light, heavy = static_equilibrium.build(knee, loads).tolerance_n
    assert heavy == pytest.approx(1000.0 * light)
    assert light == pytest.approx(0.15, rel=0.01)


def test_rows_that_nothing_carries_leave_the_others_and_their_starts_alone(knee, rest, solved):
    loads = np.tile(LOADS, (3, 1))
    loads[1, WRENCH_NAMES.index("Fy")] = 50.0
    problem = static_equilibrium.build(knee, loads, rest=rest, about="moving")
    result = static_equilibrium.solve(problem)
    np.testing.assert_allclose(result.poses[[0, 2]], solved[1].poses[[0, 2]], atol=1e-6)
    assert (solve_from_lifts(problem, result, 1, (2.0,)).shares == 1.0).all()
    with pytest.raises(ValueError, match="no row is in equilibrium"):
        solve_from_lifts(problem, replace(result, converged=np.zeros(3, dtype=bool)), 1)


@pytest.mark.parametrize("force_n", [5.0, 1500.0])
def test_light_and_heavy_loads_are_balanced_to_the_same_share(knee, force_n):
    """On elements, too, which carry some per cent of 5 N more or less in the surrogate's pose."""
    loads = force_n * np.array([[-0.02, -1.0, 0.0, 5.0, 0.0, 0.0]])
    problem = static_equilibrium.build(knee, loads, rest=[0.0, 27.5, 0.0, 0.0, 0.0, -0.5], about="moving")
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.wrenches[:, :3], loads[:, :3], atol=1e-4 * force_n)
    elements = cc.ElasticFoundation(knee.scene, (80, 40))
    wrench = elements.wrenches(static_equilibrium.on_model(problem, result, elements)).sum(axis=1)
    np.testing.assert_allclose(wrench[:, :3], loads[:, :3], atol=1e-4 * force_n)


@needs_compiler
def test_a_ball_carries_no_torque_about_its_centre_but_a_spring_does():
    model = cc.foundation("sphere_in_dish")
    loads = np.array([[20.0, -200.0, 0.0, 1000.0, 0.0, 0.0]])
    free = static_equilibrium.solve(static_equilibrium.build(model, loads, about="moving"))
    assert not free.converged.any()
    assert free.reason[0].startswith("nothing holds rx against the given loads, expected contact or a spring")
    stiffness = np.array([0.0, 0.0, 0.0, 5e3, 0.0, 0.0])
    held = static_equilibrium.build(model, loads, stiffness=stiffness, about="moving")
    result = static_equilibrium.solve(held)
    assert result.converged.all(), result.reason
    assert result.poses[0, 3] - held.rest[0, 3] == pytest.approx(1000.0 / 5e3, rel=1e-3)


def test_clamped_loads_out_of_contact_do_not_say_that_nothing_holds_what_presses():
    """Of two stages vertical forces are zero there, with no slope: a spring along ty would be no cure."""
    two_stage, apart = cc.load_surrogate("knee_two_stage"), np.array([0.0, 30.6, 0.0, -0.011, 0.0, 0.0])
    assert (two_stage(apart, ["Fy_med", "Fy_lat"]) == 0.0).all()
    problem = static_equilibrium.build(two_stage, np.array([LOADS]), rest=apart[None], about="moving")
    assert Balance.of(problem, two_stage).loose(0, apart) == []


@needs_compiler
def test_an_unsolved_row_of_a_joint_that_is_pressed_upwards_is_tried_on_the_contact_model():
    model = cc.foundation("hip")
    loads = np.array([[-100.0, 1500.0, 400.0, 7500.0, 0.0, 0.0]])  # a ball's torque
    problem = static_equilibrium.build(model, loads, rest=[model.scene.start_pose], about="moving")
    result = diagnose(problem, static_equilibrium.solve(problem), cc.ElasticFoundation(model.scene, (40, 40)))
    assert result.reason[0].startswith("nothing holds rx")
    assert result.reason[0].endswith("the contact model finds no equilibrium either")


def test_the_contact_model_says_whether_an_unsolved_row_lies_outside_of_what_was_learned(knee, rest):
    loads = np.tile(LOADS, (3, 1))
    loads[1, WRENCH_NAMES.index("Fz")] = 900.0  # up the side of the dish
    loads[2, WRENCH_NAMES.index("Tx")] = 90_000.0  # outside both condyles
    problem = static_equilibrium.build(knee, loads, rest=rest, about="moving")
    result = diagnose(problem, static_equilibrium.solve(problem), own_model(knee.scene))
    assert result.reason[0] == ""
    assert result.reason[1].startswith("outside the learned range (tz by ")
    assert "finds no equilibrium either" in result.reason[2]
    assert diagnose(problem, result, "none at hand") is result


def test_a_flexion_held_beyond_what_was_learned_is_named_whatever_the_contact_model_finds(knee, rest):
    bent = rest.copy()
    bent[1, 5] = knee.record["pose_range"]["rz"][0] - 0.7
    problem = static_equilibrium.build(knee, np.tile(LOADS, (3, 1)), rest=bent, about="moving")
    result = static_equilibrium.solve(problem)
    assert result.converged.tolist() == [True, False, True]
    for told in (result, diagnose(problem, result, own_model(knee.scene))):
        assert told.reason[1].startswith("held outside the learned range (rz by 0.7 rad): at the nearest ")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"loads": np.zeros((2, 5))}, r"loads has shape \(2, 5\)"),
        ({"loads": [0.0, -np.inf, 0.0, 0.0, 0.0, 0.0]}, r"loads holds -inf at row 0 \(Fy\)"),
        ({"free": ("tx", "tx")}, "each named once"),
        ({"free": ("tx", "qx")}, "unknown pose parameter 'qx'"),
        ({"free": POSE_NAMES}, "contact does not hold flexion"),
        ({"stiffness": [-1.0] * 6}, "expected 6 numbers >= 0"),
        ({"rest": np.zeros((2, 6))}, "rest has 2 poses"),
        ({"about": "middle"}, "about is 'middle'"),
    ],
)
def test_wrong_requests_are_refused(knee, given, said):
    arguments = {"loads": np.array([LOADS]), **given}
    with pytest.raises(ValueError, match=said):
        static_equilibrium.build(knee, **arguments)
