"""Optimal control of the simulated cycle: the known motion and loads are found again, to the transcription's order."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import casadi_contact as cc
from casadi_contact.conventions import WRENCH_NAMES
from casadi_contact.motion.joint_cycle import scene_cycles
from casadi_contact.optimisation import pose_bounds, pose_steps
from problems import knee_simulator, optimal_control, pose_estimation
from problems.common.contact import ContactSource
from problems.optimal_control import (
    __main__,
    cycle_of,
    forward_load_errors,
    forward_poses,
    missed,
    simulated_cycle,
    strays,
)
from problems.optimal_control.problem import point_function
from tests.support.command import ended
from tests.support.compiler import needs_compiler
from tests.support.interrupted import Interrupted, interrupts_remembered


@pytest.fixture(scope="module")
def wanted(knee):
    return simulated_cycle(knee, frames=201)


@pytest.fixture(scope="module")
def solved(knee, wanted):
    problem = optimal_control.build(knee, wanted, intervals=25)
    return problem, optimal_control.solve(problem)


@pytest.fixture(scope="module")
def simulated(knee):
    """The simulator, and its poses in the second cycle as a function of time."""
    simulator = knee_simulator.build(knee)
    motion = knee_simulator.solve(simulator, cycles=2.0, frames=401, tolerance=1e-8)
    return simulator, CubicSpline(motion.time_s - 1.0, motion.poses)


def applied_loads(simulator, times):
    return np.array([np.asarray(simulator.applied(t)).ravel() for t in times])


def test_wanted_loads_are_tracked_with_all_six_degrees_free(solved):
    _, result = solved
    assert result.converged, result.ipopt_status
    assert result.iterations < 40
    assert np.sqrt(np.mean(result.load_error[:, :4] ** 2)) < 0.1  # forces [N]
    assert np.sqrt(np.mean(result.load_error[:, 4:] ** 2)) < 2.0  # torques [N·mm]
    assert np.degrees(np.abs(result.held_error).max()) < 0.01


def test_it_finds_the_simulators_motion_and_applied_loads(solved, simulated):
    problem, result = solved
    off = np.abs(result.poses - simulated[1](problem.times)).max(axis=0)
    assert off[:3].max() < 0.02
    assert np.degrees(off[3:].max()) < 0.02
    applied = applied_loads(simulated[0], problem.times)
    # 25 intervals hold the accelerations less well than the poses.
    for name, scale in (("Fx", 200.0), ("Fy", 2000.0), ("Ty", 4800.0)):
        column = WRENCH_NAMES.index(name)
        assert np.sqrt(np.mean((result.actuators[:, column] - applied[:, column]) ** 2)) < 0.05 * scale


def test_actuators_come_closer_to_the_applied_loads_with_more_intervals(knee, wanted, solved, simulated):
    coarse_problem = optimal_control.build(knee, wanted, intervals=12)
    fy = WRENCH_NAMES.index("Fy")
    error = [
        np.sqrt(np.mean((result.actuators - applied_loads(simulated[0], problem.times))[:, fy] ** 2))
        for problem, result in ((coarse_problem, optimal_control.solve(coarse_problem)), solved)
    ]
    assert error[1] < 0.5 * error[0]


def test_the_found_actuators_drive_the_knee_through_the_found_motion_forward_in_time(solved):
    """To within what a spline of the actuators leaves between 25 intervals; other actuators lead elsewhere."""
    problem, result = solved
    off = np.abs(forward_poses(problem, result) - result.poses).max(axis=0)
    assert off[:3].max() < 0.2
    assert np.degrees(off[3:].max()) < 0.05
    reversed_shear = replace(result, actuators=result.actuators * [-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert np.abs(forward_poses(problem, reversed_shear) - result.poses)[:, 0].max() > 1.0


def test_a_wanted_cycle_with_a_liftoff_never_pulls_between_its_points_and_is_solved(knee, wanted):
    """The lateral side is free for a fifth of the cycle: a cubic spline would want it to pull beside that."""
    lateral, time_s = knee.load_names.index("Fy_lat"), wanted.time_s
    loads = wanted.loads.copy()
    loads[(time_s > 0.3) & (time_s < 0.5), lateral] = 0.0
    lifting = replace(wanted, loads=loads)
    at = np.linspace(time_s[0], time_s[-1], 3001)
    found, held = lifting.at(at)
    assert CubicSpline(time_s, loads[:, lateral])(at).max() > 1.0
    assert found[:, lateral].max() == 0.0
    np.testing.assert_allclose(lifting.at(time_s)[0], loads, atol=1e-9)
    others = [column for column in range(loads.shape[1]) if column != lateral]
    np.testing.assert_array_equal(found[:, others], wanted.at(at)[0][:, others])
    np.testing.assert_array_equal(held, wanted.at(at)[1])
    result = optimal_control.solve(optimal_control.build(knee, lifting, intervals=12))
    assert result.converged, result.ipopt_status


def test_actuators_that_no_motion_follows_are_told_so(solved):
    problem, result = solved
    assert forward_poses(problem, replace(result, actuators=-1e6 * result.actuators)) is None
    assert "the integrator gives up" in strays(problem, result, None)


def test_ctrl_c_forward_in_time_does_not_say_that_nothing_holds_the_motion(solved, monkeypatch):
    problem, result = solved
    contact = Interrupted(sizes=(6,), answer=len(problem.model.load_names))
    monkeypatch.setattr(type(problem.model), "function", lambda *_, **__: contact)
    with interrupts_remembered(monkeypatch), pytest.raises(KeyboardInterrupt):
        forward_poses(problem, result)


def test_of_forces_and_torques_that_stray_the_one_furthest_off_is_named(solved):
    problem, result = solved
    turned = result.poses + np.array([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])  # rad, about the superior axis: torques above all
    errors = forward_load_errors(problem, result, turned)
    largest = {name: np.abs(result.loads[:, k]).max() for k, name in enumerate(errors)}
    allowed = {kind: 0.01 * max(most for name, most in largest.items() if name[0] == kind) for kind in "FT"}
    share = {name: error / allowed[name[0]] for name, error in errors.items()}
    assert max(share[name] for name in share if name[0] == "F") > 1.0
    worst = max(share, key=share.get)
    assert worst[0] == "T"
    assert f"{worst} is off by" in strays(problem, result, turned)


def test_contact_loads_stray_from_those_found_as_far_as_the_actuators_are_wrong(solved):
    """The applied forces are what contact carries, but for inertia: a share of them too much is that share too much of
    load."""
    problem, result = solved
    assert strays(problem, result, forward_poses(problem, result)) == ""
    more = replace(result, actuators=1.05 * result.actuators)
    forward = forward_poses(problem, more)
    assert "(RMS), expected" in strays(problem, result, forward)
    rms = forward_load_errors(problem, result, forward)["Fy_med"]
    medial = result.loads[:, problem.model.load_names.index("Fy_med")]
    assert rms == pytest.approx(0.05 * np.sqrt(np.mean(medial**2)), rel=0.1)


def test_loads_that_steadiness_outweighs_are_missed_and_named_though_ipopt_has_solved(knee, wanted, solved):
    """The steadiest actuators are constant ones: the least cost is then no motion that carries the wanted loads."""
    assert missed(*solved) == ""
    problem = optimal_control.build(knee, wanted, intervals=12, steadiness=100.0)
    result = optimal_control.solve(problem)
    assert result.converged
    rms = np.sqrt(np.mean(result.load_error**2, axis=0))
    forces = [k for k, name in enumerate(knee.load_names) if name.startswith("F")]
    worst = max(forces, key=lambda k: rms[k])
    assert rms[worst] > 50.0  # N
    assert f"of the wanted loads {knee.load_names[worst]} is off by {rms[worst]:.0f} N (RMS)" in missed(problem, result)
    stopped = replace(result, converged=False, ipopt_status="Maximum_Iterations_Exceeded")
    assert "give more --intervals than 12" in missed(problem, stopped)


def test_flexion_that_bounds_keep_from_the_wanted_one_is_missed_and_named_though_all_loads_are_carried(knee, wanted):
    """A dish carries the same loads at any flexion that its condyles' arcs allow: loads alone do not tell of it."""
    still = np.ones((len(wanted.time_s), 1))
    deeper = replace(wanted, loads=wanted.loads[:1] * still, held={"rz": -1.7 * still[:, 0]})
    problem = optimal_control.build(knee, deeper, intervals=4)
    result = optimal_control.solve(problem)
    assert result.converged
    assert np.sqrt(np.mean(result.load_error[:, :4] ** 2)) < 1.0  # N
    least = pose_bounds(knee)[0][5]  # rz of the deepest flexion that it has learned
    np.testing.assert_allclose(result.held_error, least + 1.7, atol=1e-4)
    assert f"rz is off by {np.degrees(least + 1.7):.3g} degrees (RMS)" in missed(problem, result)
    assert "asks for more than the model has learned" in missed(problem, result)


def test_a_periodic_cycle_ends_where_it_began_though_the_wanted_flexion_does_not(knee, wanted):
    drifting = replace(wanted, held={"rz": wanted.held["rz"] - 0.05 * wanted.time_s})
    drift = {}
    for periodic in (True, False):
        result = optimal_control.solve(optimal_control.build(knee, drifting, intervals=12, periodic=periodic))
        assert result.converged
        drift[periodic] = result.node_poses[-1] - result.node_poses[0]
    assert drift[False][5] < -0.03
    np.testing.assert_allclose(drift[True], 0.0, atol=1e-8)


def test_legendre_points_without_periodicity_give_the_same_motion(knee, wanted, simulated):
    problem = optimal_control.build(knee, wanted, intervals=25, scheme="legendre", periodic=False)
    result = optimal_control.solve(problem)
    assert result.converged
    np.testing.assert_allclose(result.poses, simulated[1](problem.times), atol=0.02)


def test_the_elastic_foundation_carries_nearly_the_same(knee, solved):
    _, result = solved
    off = cc.ElasticFoundation(knee.scene, (160, 80))(result.poses) - result.loads
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 2.0


def test_motion_along_and_about_every_axis_is_damped(knee, wanted):
    point = point_function(knee, wanted.rig, ("rz",))
    pose = np.array(knee.learned_pose()) / pose_steps(knee.scene.sensitive_pose)
    still = [np.zeros(6), np.zeros(len(knee.load_names)), np.zeros(1)]
    begun, *moving = (np.asarray(point(pose, rate, *still)[0]).ravel() for rate in (np.zeros(6), *np.eye(6)))
    slowing = np.array(moving) - begun
    assert (np.diag(slowing) < 0.0).all()
    np.testing.assert_allclose(slowing - np.diag(np.diag(slowing)), 0.0, atol=1e-9)


def test_wrong_requests_are_refused(knee, wanted):
    with pytest.raises(ValueError, match="scheme is 'euler', expected one of radau, legendre"):
        optimal_control.build(knee, wanted, scheme="euler")
    with pytest.raises(ValueError, match="intervals 1"):
        optimal_control.build(knee, wanted, intervals=1)
    with pytest.raises(ValueError, match="3 intervals of degree 1 have 3 collocation points, expected 4 or more"):
        optimal_control.build(knee, wanted, intervals=3, degree=1)
    with pytest.raises(ValueError, match="steadiness is inf"):
        optimal_control.build(knee, wanted, steadiness=np.inf)
    with pytest.raises(ValueError, match="wanted loads have shape"):
        optimal_control.build(knee, replace(wanted, loads=wanted.loads[:, :3]))


@needs_compiler
def test_a_joint_that_is_pressed_otherwise_moves_through_the_poses_of_its_own_cycle():
    model = ContactSource(scene="hip").load_whole()
    cycle = scene_cycles(model.scene)[0]
    poses = pose_estimation.solve(pose_estimation.build(model, cycle)).poses
    problem = optimal_control.build(model, cycle_of(model), intervals=10)
    result = optimal_control.solve(problem)
    assert result.converged, result.ipopt_status
    off = np.abs(result.poses - CubicSpline(cycle.time_s, poses)(problem.times))
    assert off[:, :3].max() < 0.01
    assert np.degrees(off[:, 3:].max()) < 0.01
    assert np.abs(result.load_error[:, : len(model.scene.sensitive_loads)]).max() < 5.0
    np.testing.assert_allclose(forward_poses(problem, result), result.poses, atol=0.01)


def test_a_joint_whose_loads_lack_a_component_is_given_it():
    source = ContactSource(scene="patellofemoral")
    assert set(source.load_whole().load_names) - set(source.load().load_names) == {"Tz"}


def test_a_scene_without_a_cycle_is_told_so():
    scene = cc.load_scene("hip")
    bare = type(scene).from_tables({key: table for key, table in scene.tables.items() if key != "motion"})
    with pytest.raises(ValueError, match=r"scene hip has no \[motion\]"):
        cycle_of(cc.foundation(bare))


def test_the_command_writes_table_csv_summary_and_picture(tmp_path, monkeypatch):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--intervals", 25, "--no-periodic") == 0
    summary = json.loads((tmp_path / "optimal_control.json").read_text("utf-8"))
    assert summary["ipopt_status"] == "Solve_Succeeded"
    assert summary["reason"] == ""
    assert summary["forward_largest_error"]["mm"] < 0.2
    assert max(summary["forward_rms_load_error"][name] for name in ("Fy_med", "Fy_lat", "Fx", "Fz")) < 12.0
    assert (tmp_path / "optimal_control.csv").read_text("utf-8").count("\n") == 76
    assert (tmp_path / "optimal_control.png").read_bytes().startswith(b"\x89PNG")


def test_actuators_of_a_coarse_transcription_that_lead_elsewhere_end_with_status_2(tmp_path, monkeypatch, capsys):
    """All of its points are solved and right by themselves: between them the equations of motion do not hold."""
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--intervals", 10) == 2
    assert "not solved: forward in time under these actuators " in capsys.readouterr().err
    summary = json.loads((tmp_path / "optimal_control.json").read_text("utf-8"))
    assert summary["ipopt_status"] == "Solve_Succeeded"
    assert summary["forward_largest_error"]["mm"] > 0.5


def test_a_cycle_whose_wanted_loads_are_missed_ends_with_status_2(tmp_path, monkeypatch, capsys):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--intervals", 12, "--steadiness", 100) == 2
    told = capsys.readouterr()
    assert told.out.startswith("0 of 36 solved")
    assert "not solved: of the wanted loads " in told.err
    reason = json.loads((tmp_path / "optimal_control.json").read_text("utf-8"))["reason"]
    assert reason
    assert f"not solved: {reason}; see" in told.err


def test_a_mistake_is_one_line(tmp_path, monkeypatch):
    code = ended(monkeypatch, __main__.main, "--out", tmp_path, "--scheme", "euler")
    assert code == "optimal_control: scheme is 'euler', expected one of radau, legendre"
