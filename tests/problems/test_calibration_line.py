"""Calibration of one modulus at known poses is a straight line through the origin, F = E·φ: its formulas are known."""

import numpy as np
import pytest

import casadi_contact as cc
from problems import calibration
from problems.calibration.uncertainty import uncertainty
from tests.support.compiler import needs_compiler

pytestmark = needs_compiler
LENGTH_MM = 1e-6  # deviation of poses: no load changes by it
NOISE = np.random.default_rng(5).standard_normal((4, 6))


@pytest.fixture(scope="module")
def ball():
    return cc.PolarFoundation(cc.load_scene("sphere_on_plane"), cc.contact.Rays(12, 3))


def measured(ball, factor, noise):
    """Loads of a ball on a layer stiffer by a factor, with so many deviations of noise; and the line's slopes φ/σ."""
    poses = np.zeros((4, 6))
    poses[:, 0], poses[:, 1] = [0.0, 1.0, -2.0, 0.5], ball.scene.geometry["radius"] - np.array([0.1, 0.15, 0.2, 0.25])
    exact = calibration.Measurement(poses, ball(poses), ball.load_names, length_mm=LENGTH_MM, angle_rad=1e-8)
    loads = factor * exact.loads + noise * exact.load_deviation * NOISE
    made = calibration.Measurement(poses, loads, ball.load_names, length_mm=LENGTH_MM, angle_rad=1e-8)
    return made, exact.loads / exact.load_deviation / ball.scene.material.youngs_modulus


def test_the_deviation_of_a_modulus_does_not_depend_on_the_scenes_own(ball):
    """σ_E = 1/√Σ(φ/σ)², at whatever E."""
    for factor in (0.5, 1.0, 3.0):
        made, slopes = measured(ball, factor, 0.0)
        problem = calibration.build(ball, made, ["youngs_modulus"])
        z = problem.variables(np.array([factor * ball.scene.material.youngs_modulus]))
        found = uncertainty(problem, z, np.zeros((4, 6)))
        assert found.deviation[0] == pytest.approx(1.0 / np.sqrt(np.sum(slopes**2)), rel=1e-4)


@pytest.mark.parametrize(("noise", "scaled"), [(1.0, False), (5.0, True)])
def test_misfit_and_deviation_are_those_of_the_line(ball, noise, scaled):
    """s² = Σ(residual/σ)²/(n - 1), and a deviation of 1/√Σ(φ/σ)², times s where the stated deviations do not explain
    the residuals."""
    made, slopes = measured(ball, 2.0, noise)
    loads = made.loads / made.load_deviation
    modulus = np.sum(slopes * loads) / np.sum(slopes**2)
    s = np.sqrt(np.sum((loads - modulus * slopes) ** 2) / (loads.size - 1))
    result = calibration.solve(calibration.build(ball, made, ["youngs_modulus"]))
    assert result.solved
    assert result.values[0] == pytest.approx(modulus, rel=1e-6)
    assert result.misfit == pytest.approx(s**2, rel=1e-4)
    assert result.explained == (not scaled)
    expected = (s if scaled else 1.0) / np.sqrt(np.sum(slopes**2))
    assert result.uncertainty.deviation[0] == pytest.approx(expected, rel=1e-4)
