"""Pose estimation: golden numbers on the shipped surrogate, honest reports."""

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.optimisation.verification.verdict import judge
from casadi_contact.scenes.joint_cycle import JointCycle
from casadi_contact.scenes.load_cycle import read_cycle, write_cycle
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.project import reference_motion_cycles
from problems import pose_estimation
from problems.common.contact import ContactSource
from problems.pose_estimation.report import Tracked, draw
from problems.pose_estimation.starts import RandomStarts, StartOutcome, one_start, solve_from_random_starts
from tests.support.compiler import needs_compiler
from tests.support.shared_data import shared_file

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def solved(knee):
    problem = pose_estimation.build(knee, reference_cycle())
    return problem, pose_estimation.solve(problem)


def test_reference_cycle_converges_in_every_frame_and_the_elastic_foundation_agrees(solved):
    problem, result = solved
    assert result.converged.all(), result.reason
    forces, centres = np.split(np.abs(result.errors), 2, axis=1)  # both sides [N], both directions [mm]
    assert forces.max() < 1.0
    assert centres.max() < 0.1
    foundation = cc.ElasticFoundation(problem.model.scene, problem.model.scene.grids["teacher"])
    difference = foundation(result.poses)[:, :2] - result.loads[:, :2]
    assert np.sqrt(np.mean(difference**2)) < 3.0


def test_the_picture_tells_frames_that_the_contact_model_denies_and_frames_without_load(knee, tmp_path, monkeypatch):
    cycle = reference_cycle(frames=11)
    pressed = np.arange(11) != 4
    problem = pose_estimation.build(knee, replace(cycle, fy_med=pressed * cycle.fy_med, fy_lat=pressed * cycle.fy_lat))
    result = pose_estimation.solve(problem)
    verdict = judge(knee, result.poses, result.converged, knee, problem.wanted.load_names)
    verdict.errors[7] = 100.0
    pages = []
    monkeypatch.setattr("problems.pose_estimation.report.save_page", lambda page, path, **_: pages.append(page))
    draw(problem, result, verdict, Tracked.of(problem, result, None), "surrogate", tmp_path / "page.png")
    said = "10 of 11 frames converged, 1 differ on the contact model, 1 bear no load"
    assert pages[0].get_suptitle().endswith(said)


def test_beginning_at_the_solution_ends_there_at_once(solved):
    problem, result = solved
    again = pose_estimation.solve(problem, result.poses)
    assert again.ipopt_status == "Solve_Succeeded"
    assert again.iterations <= 12, "the barrier parameter has to fall; it once ran to the limit of 300"
    np.testing.assert_allclose(again.poses, result.poses, atol=1e-6)


def test_reference_cycle_has_its_golden_poses(solved):
    _, result = solved
    golden = json.loads((Path(__file__).parent / "golden_reference_poses.json").read_text())
    for frame, pose in golden.items():
        np.testing.assert_allclose(result.poses[int(frame)], pose, atol=0.02)  # by which networks of 0.3 N differ


@needs_compiler
def test_a_compiled_kernel_gives_the_same_solution(knee, solved):
    _, result = solved
    compiled = pose_estimation.solve(pose_estimation.build(knee, reference_cycle(), compiled=True))
    assert compiled.converged.all()
    assert abs(compiled.iterations - result.iterations) <= 3  # they differ in rounding alone
    np.testing.assert_allclose(compiled.poses, result.poses, atol=1e-6)


@pytest.mark.parametrize("name", ["og1", "og2", "og3", "og4"])
def test_measured_cycles_converge_in_every_frame(knee, name):
    cycle = read_cycle(shared_file(f"data/jw/{name}_loads.csv"))
    result = pose_estimation.solve(pose_estimation.build(knee, cycle))
    assert result.converged.all(), result.reason[~result.converged]


def test_random_starts_reach_the_same_solution(knee, solved):
    _, result = solved
    knee = ContactSource(surrogate="knee")
    outcomes = [one_start(knee, reference_cycle(), result.poses, 0.0, None, number) for number in range(5)]
    assert RandomStarts(tuple(outcomes)).reached == 5


def test_random_starts_solve_the_problem_that_was_solved_with_its_smoothness(knee):
    """Smoothed poses carry the wanted loads in some frames only: in the same ones from any start."""
    problem = pose_estimation.build(knee, reference_cycle(frames=21), smoothness=300.0)
    smooth = pose_estimation.solve(problem)
    assert 0.0 < smooth.converged.mean() < 1.0
    tried = solve_from_random_starts(ContactSource(surrogate="knee"), problem, smooth.poses, 2)
    assert [outcome.reached for outcome in tried.outcomes] == [smooth.converged.mean()] * 2


def test_solved_by_another_solution_is_told_from_unsolved():
    tried = RandomStarts((StartOutcome(1.0, 1.0, 3), StartOutcome(1.0, 0.5, 9), StartOutcome(0.5, 0.5, 6)))
    assert (tried.solved, tried.reached) == (2, 1)
    assert str(tried) == (
        "2 of 3 random starts solve every frame, 1 of them by the same solution (66.7% of all frames), "
        "median 6 IPOPT iterations"
    )


def test_a_problem_can_be_inspected_unsolved(knee):
    cycle = reference_cycle(frames=5)
    problem = pose_estimation.build(knee, cycle, smoothness=2.0)
    assert problem.nlp["x"].numel() == 4 * 5
    assert problem.residuals.numel_out() == 4 * 5
    np.testing.assert_array_equal(problem.start_poses()[:, 5], cycle.rz)


def test_a_start_far_aside_settles_so_that_ipopt_has_little_left_to_do(solved):
    problem, result = solved
    start = result.poses + np.array([8.0, 5.0, -6.0, 0.2, 0.0, 0.0])
    again = pose_estimation.solve(problem, start, max_iterations=3, alone=False)
    assert again.converged.all(), again.reason
    np.testing.assert_allclose(again.poses, result.poses, atol=0.05)


def test_frames_left_unsolved_are_solved_alone_from_their_neighbours(solved, monkeypatch):
    """A start that IPOPT cannot bring home within its iterations, in three frames among solved ones."""
    problem, result = solved
    monkeypatch.setattr(import_module("problems.pose_estimation.solve"), "settled", lambda problem, poses: poses)
    start = result.poses.copy()
    start[40:43, 0] += 4.0
    start[40:43, 2] -= 3.0
    together = pose_estimation.solve(problem, start, max_iterations=7, alone=False)
    assert not together.converged[40:43].all()
    few = pose_estimation.solve(problem, start, max_iterations=7)
    assert few.iterations > 7
    assert few.converged.all(), few.reason
    np.testing.assert_allclose(few.poses, result.poses, atol=0.01)
    none = pose_estimation.solve(problem, problem.start_poses(), max_iterations=2)
    assert not none.converged.any()
    assert all("IPOPT stopped (Maximum_Iterations_Exceeded): forces off by" in reason for reason in none.reason)


def test_smoothness_trades_tracking_for_steadier_poses(knee, solved):
    rough = solved[1]
    smooth = pose_estimation.solve(pose_estimation.build(knee, reference_cycle(), smoothness=1e6))
    steps = [np.abs(np.diff(r.poses[:, [0, 2]], axis=0)).sum() for r in (rough, smooth)]
    assert steps[1] < steps[0]
    assert np.abs(smooth.errors[:, :2]).max() > np.abs(rough.errors[:, :2]).max()


def test_loads_no_pose_can_carry_are_named_frame_by_frame(knee):
    cycle = reference_cycle(frames=11)
    outside = cycle.cop_ml_mm.copy()
    outside[4] = 60.0  # outside the insert
    result = pose_estimation.solve(pose_estimation.build(knee, replace(cycle, cop_ml_mm=outside)))
    assert not result.converged[4]
    assert "not found in the learned range: forces off by" in result.reason[4]
    assert np.delete(result.converged, 4).all()


def test_prescribed_displacement_is_held_and_the_measured_forces_settle_the_rest(knee, solved):
    """As in a simulator of ISO 14243-3: flexion, rotation and tx are given, and contact tells the force against tx."""
    problem, found = solved
    cycle, loads = problem.cycle, dict(zip(knee.load_names, knee(found.poses).T, strict=True))
    given = {name: found.poses[:, POSE_NAMES.index(name)] for name in ("tx", "ry", "rz")}
    measured = {name: loads[name] for name in ("Fy_med", "Fy_lat", "Fz")}
    driven = pose_estimation.solve(pose_estimation.build(knee, JointCycle("driven", cycle.time_s, given, measured)))
    assert driven.converged.all()
    for name, curve in given.items():
        np.testing.assert_array_equal(driven.poses[:, POSE_NAMES.index(name)], curve)
    np.testing.assert_allclose(driven.poses, found.poses, atol=1e-3)
    np.testing.assert_allclose(knee(driven.poses)[:, knee.load_names.index("Fx")], loads["Fx"], atol=0.1)


def with_prescribed(path, column):
    """A knee's cycle file with one more column, which holds 1.5, and the same with flexion and rotation renamed."""
    write_cycle(reference_cycle(frames=5), path)
    header, *rows = path.read_text().splitlines()
    text = "\n".join([f"{header},{column}", *(f"{row},1.5" for row in rows)])
    path.write_text(text)
    renamed = path.with_name("renamed.csv")
    renamed.write_text(text.replace("flexion_rz_rad", "rz_rad").replace("rotation_ry_rad", "ry_rad"))
    return path, renamed


@pytest.mark.parametrize("column", ["tx_mm", "tx_m", "tx"])
def test_prescribed_displacement_beside_a_knees_own_columns_is_refused_and_not_ignored(tmp_path, column):
    machine, _ = with_prescribed(tmp_path / "machine.csv", column)
    with pytest.raises(ValueError, match=rf"has {column} beside .* rename flexion_rz_rad and rotation_ry_rad"):
        reference_motion_cycles(cc.load_scene("knee"), [machine])


def test_a_knees_file_renamed_so_that_displacement_is_held_keeps_its_centre_of_pressure(knee, tmp_path):
    _, renamed = with_prescribed(tmp_path / "machine.csv", "tx_mm")
    (cycle,) = reference_motion_cycles(knee.scene, [renamed])
    problem = pose_estimation.build(knee, cycle)
    np.testing.assert_array_equal(cycle.measured_pose()["tx"], 1.5)
    walking = reference_cycle(frames=5)
    for name, curve in (("cop_ap", walking.cop_ap_mm), ("cop_ml", walking.cop_ml_mm)):
        np.testing.assert_array_equal(problem.wanted.values[name], curve)


def test_wrong_requests_are_refused(knee):
    for smoothness in (-1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=f"smoothness is {smoothness}, expected a finite number >= 0"):
            pose_estimation.build(knee, reference_cycle(), smoothness=smoothness)
    with pytest.raises(ValueError, match="start has 3 poses, expected one for each of 101 frames"):
        pose_estimation.solve(pose_estimation.build(knee, reference_cycle()), np.zeros((3, 6)))
