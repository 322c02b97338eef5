"""Muscle-driven forward simulation: what balances inversely stays balanced, energy, exact Jacobian, mistakes."""

import csv
import json
import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.optimisation.muscle_contact import MuscleContact
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.optimisation.verification.verdict import judge
from problems import muscle_driven
from problems.muscle_driven import __main__
from problems.muscle_driven.problem import POWERS
from problems.muscle_driven.report import Run, differences, report
from tests.support.command import ended
from tests.support.compiler import needs_compiler
from tests.support.interrupted import Interrupted, interrupts_remembered

MOVING = [1, 3, 5]

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def driven():
    knee, walk = cc.load_surrogate("knee"), example_walk(frames=51)
    problem = MuscleContact(knee, walk)
    return muscle_driven.build(knee, problem, problem.solve())


@pytest.fixture(scope="module")
def simulation(driven):
    return muscle_driven.solve(driven)


def test_activations_of_the_inverse_solution_drive_the_walk_they_came_from(driven, simulation):
    run = Run.of(driven, simulation, simulation.seconds)
    found = differences(driven, run)
    assert found["Fy_med_percent_of_peak"] < 5.0
    assert found["Fy_lat_percent_of_peak"] < 5.0
    assert found["flexion_deg"] < 1.0
    np.testing.assert_allclose(simulation.poses[:, [0, 2, 4]], driven.solved.poses[:, [0, 2, 4]], atol=1e-9)


def test_ctrl_c_in_the_integrator_is_not_the_users_mistake(driven, monkeypatch):
    x, t, rate = ca.MX.sym("x", 6), ca.MX.sym("t"), Interrupted(sizes=(6,), answer=6)
    monkeypatch.setattr(type(driven), "dae", lambda _: {"x": x, "t": t, "ode": rate(x), "quad": x[: len(POWERS)]})
    with interrupts_remembered(monkeypatch), pytest.raises(KeyboardInterrupt):
        muscle_driven.solve(driven)


def test_in_every_frame_of_the_inverse_solution_only_the_walk_s_own_acceleration_is_left(driven):
    inertia, poses = driven.leg.inertia, driven.solved.poses
    undamped = muscle_driven.build(
        driven.model,
        driven.inverse,
        driven.solved,
        replace(driven.leg, damping_ns_per_mm=0.0, damping_nmms_per_rad=(0.0, 0.0)),
    )
    for frame in range(0, 51, 5):
        time_s = driven.time_s[frame]
        _, speed, acceleration = np.asarray(driven.flexion(time_s)).ravel()
        state = [*poses[frame, MOVING], 0.0, 0.0, speed]
        left = inertia * (np.asarray(undamped.rate(state, time_s)).ravel()[3:] - [0.0, 0.0, acceleration])
        np.testing.assert_allclose(left / [1.0, 25.0, 25.0], 0.0, atol=0.5)


def test_work_becomes_kinetic_energy_or_is_damped(driven, simulation):
    muscles = simulation.work[:, POWERS.index("muscles")]
    assert np.abs(muscles).max() > 1e3
    assert np.abs(simulation.energy_error).max() < 1e-4 * np.abs(muscles).max()
    assert np.diff(simulation.work[:, POWERS.index("damping")]).max() <= 0.0
    coarse = muscle_driven.solve(driven, tolerance=1e-3)
    assert np.abs(coarse.energy_error).max() > np.abs(simulation.energy_error).max()


def test_walks_of_fewer_frames_than_a_spline_needs_are_refused(driven):
    inverse = MuscleContact(driven.model, example_walk(3))
    with pytest.raises(ValueError, match="walk built-in walk has 3 frames, expected at least 4, for cubic splines"):
        muscle_driven.build(driven.model, inverse, inverse.solve())


def test_the_jacobian_of_the_motion_is_exact(driven):
    x, t = ca.MX.sym("x", 6), ca.MX.sym("t")
    slope = ca.Function("slope", [x, t], [ca.jacobian(driven.rate(x, t), x)])
    time_s = driven.time_s[12] + 0.003
    state = np.array([*driven.solved.poses[12, MOVING], 0.4, 0.02, -0.3])
    exact, differences_ = np.asarray(slope(state, time_s)), np.empty((6, 6))
    for k, step in enumerate([1e-5, 1e-7, 1e-6, 1e-3, 1e-3, 1e-3]):
        move = step * np.eye(6)[k]
        ends = [np.asarray(driven.rate(state + side * move, time_s)).ravel() for side in (-2, -1, 1, 2)]
        differences_[:, k] = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
    np.testing.assert_allclose(exact, differences_, rtol=1e-5, atol=1e-6 * np.abs(exact).max())


def test_muscles_resist_a_faster_flexion_and_quadriceps_extend(driven):
    time_s = driven.time_s[8]
    rz, speed, _ = np.asarray(driven.flexion(time_s)).ravel()
    state = np.array([*driven.solved.poses[8, MOVING[:2]], rz, 0.0, 0.0, speed])

    def extension(of, at):
        return float(of.rate(at, time_s)[5])

    faster = [*state[:5], state[5] + 1.0]
    assert extension(driven, faster) < extension(driven, state)
    quadriceps = [driven.inverse.walk.muscles.names.index(name) for name in ("vasint", "vaslat", "vasmed")]
    stronger = driven.solved.activations.copy()
    stronger[:, quadriceps] += 0.1
    capacity = driven.inverse.capacity
    solved = replace(
        driven.solved, activations=stronger, muscle_forces_n=capacity.active_n * stronger + capacity.passive_n
    )
    assert extension(muscle_driven.build(driven.model, driven.inverse, solved), state) > extension(driven, state)


def test_a_foundation_moves_the_knee_as_the_network_that_learned_it(driven, simulation, tmp_path):
    foundation = PolarFoundation(driven.model.scene, Rays(12, 3))
    other = muscle_driven.build(foundation, driven.inverse, driven.solved)
    moved = muscle_driven.solve(other, tolerance=1e-5)
    np.testing.assert_allclose(moved.poses[:, 5], simulation.poses[:, 5], atol=2e-3)
    np.testing.assert_allclose(moved.wrenches[:, 1], simulation.wrenches[:, 1], atol=10.0)
    both = {"surrogate": driven, "foundation": other}
    runs = {name: Run.of(both[name], one, one.seconds) for name, one in zip(both, (simulation, moved), strict=True)}
    report(both, runs, judge(driven.model, simulation.poses, True, "no model asked"), tmp_path)
    rows = list(csv.DictReader((tmp_path / "muscle_driven.csv").open()))
    assert float(rows[20]["Fy_med_N"]) == pytest.approx(runs["surrogate"].sides[20, 0], abs=0.01)
    assert rows[20]["verdict"] == "solved, not checked"
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["verdict"].startswith("51 of 51 solved, not checked: no model asked")
    assert summary["reason"] == ""
    assert summary["models"]["foundation"]["flexion_deg"] < 1.0
    assert (tmp_path / "muscle_driven.png").read_bytes().startswith(b"\x89PNG")


def test_a_motion_that_makes_energy_is_no_solution(tmp_path, monkeypatch, capsys):
    """At steps so coarse that more energy appears than the muscles give, contact still looks right pose by pose."""
    monkeypatch.setattr(__main__, "walk_of", lambda *_: example_walk(frames=21))
    assert ended(monkeypatch, __main__.main, "--tolerance", 0.1, "--repeats", 1, "--out", tmp_path) == 2
    said = capsys.readouterr()
    assert said.out.startswith("0 of 21 solved")
    assert "% on surrogate" in said.err
    assert "give a smaller --tolerance" in said.err
    summary = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert summary["verdict"].startswith("0 of 21 solved")
    assert summary["reason"]
    assert f"not solved: {summary['reason']}; see {tmp_path}" in said.err
    rows = csv.DictReader((tmp_path / "muscle_driven.csv").open(encoding="utf-8"))
    assert {row["verdict"] for row in rows} == {"not solved"}


def test_a_motion_that_leaves_the_walk_in_a_gap_of_time_is_no_solution(tmp_path, monkeypatch, capsys):
    """Where a tenth of the cycle is missing, splines invent it: the knee flexes otherwise, in poses that look right."""
    walk = example_walk(frames=101)
    kept = np.r_[0:62, 72:101]
    cut = replace(
        walk,
        **{name: getattr(walk, name)[kept] for name in ("time_s", "rz", "ry", "lengths_m", "velocities_m_per_s")},
        loads={name: curve[kept] for name, curve in walk.loads.items()},
        arms={name: table[kept] for name, table in walk.arms.items()},
    )
    monkeypatch.setattr(__main__, "walk_of", lambda *_: cut)
    assert ended(monkeypatch, __main__.main, "--repeats", 1, "--out", tmp_path) == 2
    said = capsys.readouterr()
    assert said.out.startswith("0 of 91 solved")
    assert re.search(r"leaves the flexion of walk built-in walk by \d+° on surrogate", said.err)
    assert "apart after frame 61, are not its curves; give frames closer to each other" in said.err


def test_reserves_that_would_be_missing_forward_are_named_with_their_frames(driven):
    reserves = {name: curve.copy() for name, curve in driven.solved.reserves.items()}
    reserves["knee_flexion"][[3, 4, 9]] = 0.5
    with pytest.raises(ValueError, match=r"reserves give up to 0.5 N or N·m in frames 3, 4, 9, at most 0.1 expected"):
        muscle_driven.build(driven.model, driven.inverse, replace(driven.solved, reserves=reserves))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--muscles", "m.csv"), "--inverse-dynamics, --parameters, --rotations not given"),
    ],
)
def test_a_mistake_is_one_line_and_a_nonzero_exit(arguments, said, monkeypatch, tmp_path):
    message = ended(monkeypatch, __main__.main, *arguments, "--out", tmp_path)
    assert said in message
    assert len(message.splitlines()) == 1
