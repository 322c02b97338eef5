"""Optimal control finds the simulator's known motion and loads; a forward integration under its controls agrees."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from problems import knee_simulator, optimal_control
from problems.collocation import Collocation


@pytest.fixture(scope="module")
def target(knee):
    return optimal_control.simulated(knee, frames=201)


@pytest.fixture(scope="module")
def control(knee, target):
    return optimal_control.solve(knee, target, intervals=25)


def test_it_finds_the_simulators_motion_and_applied_loads(knee, target, control):
    off = control.loads - CubicSpline(target.time_s, target.loads)(control.time_s)
    assert np.sqrt(np.mean(off[:, :4] ** 2, axis=0)).max() < 0.1
    np.testing.assert_allclose(control.poses[:, 5], CubicSpline(target.time_s, target.rz)(control.time_s), atol=1e-4)
    simulator = knee_simulator.build(knee)
    motion = knee_simulator.simulate(
        simulator, knee_simulator.start_state(simulator), cycles=2.0, frames=401, tolerance=1e-8
    )
    poses = CubicSpline(motion.time_s[200:] - 1.0, motion.poses[200:])(control.time_s)
    assert np.abs(control.poses - poses)[:, :3].max() < 0.02
    applied = np.array([np.asarray(simulator.given(t))[:, 0] for t in control.time_s])
    assert np.sqrt(np.mean((control.actuators - applied)[:, :3] ** 2)) < 10.0


def test_the_controls_drive_the_knee_through_the_found_motion(knee, control):
    driven = optimal_control.forward(knee, control)
    assert np.abs(driven - control.poses)[:, :3].max() < 0.2
    pushed = replace(control, actuators=1.1 * control.actuators)
    loads = knee(optimal_control.forward(knee, pushed))
    assert loads[:, :2].sum() == pytest.approx(1.1 * control.loads[:, :2].sum(), rel=0.02)


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
def test_collocation_is_exact_for_polynomials_of_its_degree(scheme):
    grid, curve = Collocation(4, 3, 2.0, scheme), np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    nodes, points = ca.MX(curve(np.linspace(0.0, 2.0, 5))[None]), ca.MX(curve(grid.times_s)[None])
    rates = np.array(ca.evalf(grid.derivatives(nodes, points) / grid.step_s))[0]
    np.testing.assert_allclose(rates, curve.deriv()(grid.times_s), atol=1e-12)
    np.testing.assert_allclose(np.array(ca.evalf(grid.jumps(nodes, points))), 0.0, atol=1e-12)
    assert grid.weights @ curve(grid.times_s) == pytest.approx(curve.integ()(2.0) / 2.0, rel=1e-12)


def test_motion_along_and_about_every_axis_is_damped(knee):
    forces = optimal_control.acceleration_forces(knee)
    pose = np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])
    for k in range(6):
        rates = np.eye(6)[k]
        damped = np.asarray(forces(pose, rates, np.zeros(6))[0] - forces(pose, np.zeros(6), np.zeros(6))[0])[:, 0]
        np.testing.assert_allclose(damped, -optimal_control.DAMPING * rates)


def test_the_program_prints_its_table_and_draws(tmp_path, capsys):
    optimal_control.main(intervals=16, out=tmp_path)
    assert "forward" in capsys.readouterr().out
    assert (tmp_path / "optimal_control.csv").read_text("utf-8").count("\n") == 49
    assert (tmp_path / "optimal_control.png").stat().st_size > 1000
