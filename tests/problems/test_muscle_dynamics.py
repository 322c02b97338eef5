"""Activation dynamics and compliant tendons: what a muscle can reach in time, equilibrium of fibre and tendon."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

import casadi_contact as cc
from casadi_contact.optimisation.muscle import (
    MAX_FIBRE_SPEED_PER_S,
    MuscleParameters,
    active_force_length,
    force_velocity,
    passive_force_length,
)
from casadi_contact.optimisation.muscle_walk import example_walk
from problems import muscle_contact
from problems.muscle_contact.dynamics import FALL_S, RISE_S, TENDON_STRAIN, activation_rows, equilibrium_rows

ONE = MuscleParameters(("one",), np.array([1000.0]), np.array([0.1]), np.array([0.2]), np.array([0.3]))
TIMES = np.array([0.0, 0.01, 0.02])


def evaluate(expression, *symbols_and_values):
    symbols, values = symbols_and_values[::2], symbols_and_values[1::2]
    return np.asarray(ca.Function("f", list(symbols), [expression]).call(list(values))[0])


def driven(excitation, start, step_s, count):
    """Backward Euler of ȧ = (e - a)/τ, τ rising or falling."""
    values = [start]
    for _ in range(count):
        tau = RISE_S if excitation > values[-1] else FALL_S
        values.append((values[-1] + step_s / tau * excitation) / (1.0 + step_s / tau))
    return np.array(values)[None]


def test_what_an_excitation_between_0_and_1_reaches_is_allowed_and_no_more():
    time_s = 0.01 * np.arange(6)
    a = ca.MX.sym("a", 1, 6)
    rows = activation_rows(a, time_s)
    for excitation, start in ((1.0, 0.05), (0.0, 0.9), (0.5, 0.1), (0.3, 0.8)):
        assert evaluate(rows, a, driven(excitation, start, 0.01, 5)).min() > -1e-12
    assert evaluate(rows, a, driven(1.2, 0.05, 0.01, 5)).min() < -0.1
    assert evaluate(rows, a, driven(-0.2, 0.9, 0.01, 5)).min() < -0.1


@pytest.mark.parametrize("length_m", [0.26, 0.295, 0.32])
def test_a_resting_muscle_shares_its_length_between_fibre_and_tendon(length_m):
    def surplus(tension):
        tendon = 0.2 * (1.0 + np.log((tension + 0.2) / 0.2) / np.log(6.0) * TENDON_STRAIN)
        along = length_m - tendon
        fibre = np.hypot(along, 0.1 * np.sin(0.3))
        fibre_pull = 0.6 * active_force_length(fibre / 0.1) * force_velocity(0.0) + passive_force_length(fibre / 0.1)
        return fibre_pull * along / fibre - tension

    tension = brentq(surplus, 0.0, 1.5)
    f = ca.MX.sym("f", 1, 3)
    rows = equilibrium_rows(ONE, np.full((3, 1), length_m), TIMES, ca.MX(np.full((1, 3), 0.6)), f)
    np.testing.assert_allclose(evaluate(rows, f, np.full((1, 3), tension)), 0.0, atol=1e-9)


def test_a_tendon_is_as_long_as_its_slack_length_unloaded_and_strained_by_its_share_under_the_greatest_force():
    """A fibre at its optimum, fully active, pulls F0·cos α; the tendon's strain there is TENDON_STRAIN at F0."""
    for tension, strain in ((0.0, 0.0), (1.0, TENDON_STRAIN)):
        length = 0.2 * (1.0 + strain) + np.sqrt(0.1**2 - (0.1 * np.sin(0.3)) ** 2)
        f = ca.MX.sym("f", 1, 3)
        rows = equilibrium_rows(ONE, np.full((3, 1), length), TIMES, ca.MX(np.ones((1, 3))), f)
        pull = (active_force_length(1.0) * force_velocity(0.0) + passive_force_length(1.0)) * np.cos(0.3)
        np.testing.assert_allclose(evaluate(rows, f, np.full((1, 3), tension)), pull - tension, atol=1e-9)


def test_a_shortening_fibre_pulls_less():
    lengths = np.array([[0.300], [0.299], [0.298]])
    f = ca.MX.sym("f", 1, 3)
    rows = equilibrium_rows(ONE, lengths, TIMES, ca.MX(np.ones((1, 3))), f)
    still = equilibrium_rows(ONE, np.full((3, 1), 0.298), TIMES, ca.MX(np.ones((1, 3))), f)
    tension = np.full((1, 3), 0.5)
    drop = evaluate(still - rows, f, tension)[0, 2]
    along = lengths[:, 0] - 0.2 * (1.0 + np.log((0.5 + 0.2) / 0.2) / np.log(6.0) * TENDON_STRAIN)
    fibre = np.hypot(along, 0.1 * np.sin(0.3)) / 0.1
    velocity = (fibre[2] - fibre[1]) / 0.01 / MAX_FIBRE_SPEED_PER_S
    slower = active_force_length(fibre[2]) * (force_velocity(0.0) - force_velocity(velocity))
    slower *= along[2] / (0.1 * fibre[2])
    assert drop == pytest.approx(slower, rel=1e-9)
    assert drop > 0.1


def test_a_walk_with_both_is_solved_and_what_it_finds_can_be_driven_and_pulled():
    walk = example_walk(frames=41)
    problem = muscle_contact.build(cc.load_surrogate("knee"), walk, activation_dynamics=True, compliant_tendons=True)
    result = muscle_contact.solve(problem)
    assert result.converged.all(), result.reason
    assert not result.overloaded.any()
    a = result.activations.T
    assert evaluate(activation_rows(ca.MX(a), walk.time_s)).min() > -1e-6
    muscles = walk.muscles.fitted_to(walk.lengths_m)
    tensions = result.muscle_forces_n.T / muscles.max_isometric_force_n[:, None]
    rows = equilibrium_rows(muscles, walk.lengths_m, walk.time_s, ca.MX(a), ca.MX(tensions))
    assert np.abs(evaluate(rows)).max() < 1e-6
    at_once = muscle_contact.solve(muscle_contact.build(problem.contact_model, walk))
    assert np.abs(at_once.activations - result.activations).max() > 0.01, "dynamics tell somewhere"


def test_tendons_stretch_in_hill_muscles_alone():
    with pytest.raises(ValueError, match="muscle model is isometric, expected hill where tendons are compliant"):
        muscle_contact.build(
            cc.load_surrogate("knee"), example_walk(frames=5), model="isometric", compliant_tendons=True
        )
