"""Pose estimation: measured cycles, other joints, hard frames."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cup import CupFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import POSE_IN_MM
from casadi_contact.optimisation.ipopt import FrameOutcome
from casadi_contact.optimisation.pose_estimation import PoseEstimation, PoseTargets
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.scenes.cycle import Cycle, read_cycle, scene_cycles
from casadi_contact.scenes.walking import reference_cycle
from problems.pose_estimation import check_targets
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file


@pytest.fixture(scope="module")
def solved(knee):
    problem = PoseEstimation.of_cycle(knee, reference_cycle())
    return problem, problem.solve()


def few_frames(cycle, every=20):
    curves = [{name: curve[::every] for name, curve in part.items()} for part in (cycle.pose, cycle.loads)]
    return Cycle(cycle.name, cycle.time_s[::every], *curves)


def test_the_reference_cycle_is_solved_in_few_iterations(solved):
    problem, result = solved
    assert result.ipopt.iterations <= 4
    again = problem.solve(result.poses)
    assert again.ipopt.iterations <= 4, "begun at the solution, IPOPT's own scaling once ran to the limit of 300"
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-6)


def test_the_objective_is_half_the_squares_of_misfits_and_of_weighted_steps(knee):
    cycle = reference_cycle(frames=4)
    rough, smooth = (PoseEstimation.of_cycle(knee, cycle, smoothness=weight) for weight in (0.0, 30.0))
    pressed = rough.contact.start_poses({"Fy_med": -700.0, "Fy_lat": -500.0})
    poses = pressed + np.random.default_rng(0).normal(size=(4, 6)) * [0.1, 0.01, 0.1, 0.001, 0, 0]
    x = rough.contact.variables(poses)
    poses = rough.contact.poses_with(poses, x)
    values = [float(ca.Function("f", [p.nlp["x"]], [p.nlp["f"]])(x)) for p in (rough, smooth)]
    r = np.asarray(rough.residuals(x.reshape(4, -1).T))
    assert values[0] == pytest.approx(0.5 * np.sum(r**2))
    medial, lateral, torque = knee(poses, ["Fy_med", "Fy_lat", "Tz"]).T
    assert medial.max() < -100.0
    np.testing.assert_allclose(r[2], (torque - rough.targets.values["cop_ap"] * (medial + lateral)) / 10.0, atol=1e-6)
    steps_mm = (np.diff(poses, axis=0) * POSE_IN_MM)[:, rough.contact.columns]
    assert values[1] - values[0] == pytest.approx(0.5 * 30.0 * np.sum(steps_mm**2))


@needs_compiler
def test_the_foundation_gives_the_surrogate_s_poses(knee):
    cycle = reference_cycle(frames=5)
    learned = PoseEstimation.of_cycle(knee, cycle).solve()
    problem = PoseEstimation.of_cycle(PolarFoundation(knee.scene, Rays(8, 3)), cycle)  # as cc.foundation chooses
    result = problem.solve()
    np.testing.assert_allclose(result.poses, learned.poses, atol=0.05)
    teacher = reference_model(knee.scene)
    assert cc.verify(problem.model, result.poses, teacher, result.solved, problem.targets.load_names).exit_code == 0


@pytest.mark.parametrize("name", ["walk", "og1", "og2", "og3", "og4"])
@pytest.mark.parametrize("surrogate", ["knee", "knee_two_stage"])
def test_cycles_are_solved_in_every_frame_without_warnings_and_the_elements_agree(surrogate, name):
    """The second settles its own loads far off, in false contact: it begins where the elements settle."""
    model, walk = cc.load_surrogate(surrogate), reference_cycle()
    cycle = walk if name == "walk" else read_cycle(shared_file(f"data/jw/{name}_loads.csv"))
    problem = PoseEstimation.of_cycle(model, cycle)
    assert check_targets(problem.targets) == []
    result, elements = problem.solve(), reference_model(model.scene)
    assert result.solved.all()
    assert np.sqrt(np.mean((elements(result.poses)[:, :2] - result.loads[:, :2]) ** 2)) < 1.0


@needs_compiler
@pytest.mark.parametrize(
    ("name", "model", "pressing"),
    [("hip", CupFoundation, None), ("glenohumeral", CupFoundation, ("tz",)), ("patellofemoral", PolarFoundation, None)],
)
def test_another_joint_s_own_motion_is_found_again_from_starts_off_and_too_deep(name, model, pressing):
    scene = cc.load_scene(name)
    cycle = few_frames(scene_cycles(scene)[0])
    problem = PoseEstimation.of_cycle(model(scene if pressing is None else scene.with_sensitive_pose(pressing)), cycle)
    result = problem.solve()
    assert result.solved.all()
    loads = problem.targets.load_names
    assert cc.verify(problem.model, result.poses, reference_model(scene), result.solved, loads).exit_code == 0
    for seed in range(2):
        move = np.random.default_rng(seed).uniform(-1.0, 1.0, (problem.frames, len(problem.free)))
        start = result.poses.copy()
        start[:, problem.contact.columns] += move * np.array([3.0, 3.0, 3.0, 0.1, 0.1, 0.1])[problem.contact.columns]
        np.testing.assert_allclose(problem.solve(start).poses, result.poses, atol=1e-4)


@needs_compiler
def test_locked_parameters_of_a_scene_stay_and_contradicting_measurements_are_refused():
    model = PolarFoundation(cc.load_scene("planar_knee"), Rays(8, 2))
    measured = few_frames(scene_cycles(model.scene)[0], every=25)
    problem = PoseEstimation.of_cycle(model, measured)
    assert problem.free == ("ty",)
    result = problem.solve()
    np.testing.assert_allclose(model(result.poses, ["Fy"])[:, 0], measured.loads["Fy"], atol=1e-3)
    np.testing.assert_array_equal(result.poses[:, [2, 3, 4]], 0.0)
    with pytest.raises(ValueError, match="locked"):
        PoseEstimation(model, measured.loads, {**measured.pose, "rx": np.full(problem.frames, 0.2)})


@needs_compiler
def test_a_frame_without_load_has_no_pose_to_find_and_leaves_the_others_alone():
    scene = cc.load_scene("hip")
    cycle = few_frames(scene_cycles(scene)[0])
    known = PoseEstimation.of_cycle(CupFoundation(scene), cycle).solve()
    unloaded = np.isin(np.arange(len(cycle.time_s)), [0, 2, 3])
    lifted = replace(cycle, loads={name: np.where(unloaded, 0.0, curve) for name, curve in cycle.loads.items()})
    result = PoseEstimation.of_cycle(CupFoundation(scene), lifted).solve()
    np.testing.assert_array_equal(result.outcome == FrameOutcome.NO_LOAD, unloaded)
    np.testing.assert_allclose(result.poses[~unloaded], known.poses[~unloaded], atol=1e-6)


@needs_compiler
def test_forces_that_are_parts_of_a_normal_load_settle_from_the_first_touch():
    """A hip's normal load is the size of three forces: one unknown, its translation is measured."""
    model = CupFoundation(cc.load_scene("hip"))
    cycle = few_frames(scene_cycles(model.scene)[0])
    poses = PoseEstimation.of_cycle(model, cycle).solve().poses
    parts = PoseEstimation(model, {n: cycle.loads[n] for n in ("Fy", "Fz")}, {**cycle.pose, "tx": poses[:, 0]}).solve()
    assert parts.solved.all()
    np.testing.assert_allclose(parts.poses, poses, atol=1e-4)


def test_frames_beyond_the_learned_range_are_said_not_to_be_solved(knee):
    """A swing phase whose centre of pressure moves 29 mm behind: the surrogate has not learned tx so far."""
    frames, cycle = np.arange(66, 93, 3), reference_cycle()
    share = np.sin(np.linspace(0.0, np.pi, len(frames)))
    lighter = 1.0 - share * (1.0 + 120.0 / sum(cycle.loads.values())[frames])
    targets = {name: lighter * force[frames] for name, force in cycle.loads.items()}
    targets |= {name: centre[frames] for name, centre in cycle.centres.items()}
    targets["cop_ap"] = (1.0 - share) * targets["cop_ap"] + share * 29.0
    problem = PoseEstimation(knee, targets, {name: angle[frames] for name, angle in cycle.pose.items()})
    result = problem.solve()
    assert 2 <= (~result.solved).sum() < len(frames)
    assert problem.targets.met(result.errors)[result.solved].all()
    assert problem.in_range(result.poses[result.solved]).all()


def test_loads_that_are_not_targets_may_press_and_a_torque_tells_that_something_does(knee):
    scene = knee.scene
    one_side = PoseTargets.of(scene, {"Fy_med": np.array([-90.0, 0.0])})
    np.testing.assert_array_equal(one_side.loaded, [True, False])
    np.testing.assert_array_equal(one_side.met(np.zeros((2, 1))), [True, False])
    assert PoseTargets.of(scene, {"Fy_med": np.array([-90.0, 0.0]), "cop_ap": np.zeros(2)}).loaded.all()
    by_torque = PoseTargets.of(scene, {"Fx": np.zeros(2), "Tx": np.array([6e3, 6e3])})
    assert by_torque.loaded.all()
    np.testing.assert_array_equal(by_torque.met(np.array([[0.9, -24.0], [0.9, 26.0]])), [True, False])  # 1 N at 25 mm


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        (lambda c: {name: 1e-3 * force for name, force in c.loads.items()}, "kN"),
        (lambda c: {"cop_ml": c.centres["cop_ml"] + 12.0}, "origin"),
    ],
)
def test_wrong_units_and_signs_are_warned_of(knee, changed, word):
    cycle = reference_cycle()
    assert not check_targets(PoseTargets.of(knee.scene, cycle.estimation_targets()))
    (warning,) = check_targets(PoseTargets.of(knee.scene, cycle.estimation_targets() | changed(cycle)))
    assert word in warning


@pytest.mark.parametrize(
    ("targets", "measured", "settings", "word"),
    [
        ({"Fy_med": -1.0}, ("ry", "rz"), {}, "measure"),
        ({"Fy_med": -1.0, "Fy_lat": -1.0, "Tx": 0.0}, ("ty", "ry", "rz"), {}, "free"),
        ({"Fq": -1.0}, ("tx", "tz", "rx", "ry", "rz"), {}, "Fq"),
        ({"cop_ap": 1.0, "cop_x": 1.0}, ("ry", "rz"), {}, "same"),
        ({"Fy_med": -1.0}, ("tx", "tz", "rx", "ry", "rz"), {"smoothness": np.nan}, "smoothness"),
    ],
)
def test_wrong_requests_are_refused(knee, targets, measured, settings, word):
    with pytest.raises(ValueError, match=word):
        PoseEstimation(
            knee,
            {name: np.full(3, value) for name, value in targets.items()},
            dict.fromkeys(measured, np.zeros(3)),
            **settings,
        )
