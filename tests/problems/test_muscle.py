"""Hill muscles: normalised curves, their slopes, and what a muscle cannot be."""

from dataclasses import replace

import numpy as np
import pytest

from problems.muscle_contact import muscle
from problems.muscle_contact.muscle import MuscleParameters, force_capacity

LENGTHS, SPEEDS = np.linspace(0.4, 1.7, 27), np.linspace(-1.0, 1.0, 21)
ONE = MuscleParameters(("one",), np.array([1000.0]), np.array([0.1]), np.array([0.2]), np.array([0.3]))


def slope(curve, x):
    """Derivative by a complex step, exact to rounding."""
    return curve(x + 1e-30j).imag / 1e-30


def test_curves_meet_their_definitions():
    np.testing.assert_allclose(muscle.force_velocity(np.array([-1.0, 0.0])), [0.0, 1.0], atol=1e-4)
    np.testing.assert_allclose(muscle.passive_force_length(np.array([0.2, 1.6])), [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(muscle.active_force_length(np.array([1.0])), 1.0, atol=0.01)
    assert muscle.active_force_length(LENGTHS).max() < 1.01
    assert muscle.force_velocity(np.array([1.0]))[0] == pytest.approx(1.794, abs=0.001)
    assert muscle.passive_force_length(np.array([muscle.LONGEST_FIBRE]))[0] == pytest.approx(0.07, abs=0.005)


def test_slopes_agree_with_their_closed_forms():
    d1, d2, d3, _ = -0.3211346127989808, -8.149, -0.374, 0.0
    np.testing.assert_allclose(
        slope(muscle.force_velocity, SPEEDS), d1 * d2 / np.sqrt((d2 * SPEEDS + d3) ** 2 + 1.0), rtol=1e-12
    )
    passive = 4.0 / 0.6 * np.exp(4.0 * (LENGTHS - 1.0) / 0.6) / (np.exp(4.0) - np.exp(4.0 * (0.2 - 1.0) / 0.6))
    np.testing.assert_allclose(slope(muscle.passive_force_length, LENGTHS), passive, rtol=1e-12)
    step = 1e-6
    centred = muscle.active_force_length(LENGTHS + step) - muscle.active_force_length(LENGTHS - step)
    np.testing.assert_allclose(slope(muscle.active_force_length, LENGTHS), centred / (2.0 * step), atol=1e-8)


def test_a_resting_muscle_at_optimal_length_gives_its_greatest_force_along_the_tendon():
    length = ONE.tendon_slack_length_m + ONE.optimal_fibre_length_m * np.cos(ONE.pennation_rad)
    capacity = force_capacity(ONE, length[None], np.zeros((1, 1)))
    assert capacity.fibre[0, 0] == pytest.approx(1.0, abs=1e-12)
    assert capacity.active_n[0, 0] == pytest.approx(1000.0 * np.cos(0.3), rel=0.01)
    shortening = force_capacity(ONE, length[None], np.array([[-0.5]]))
    stretching = force_capacity(ONE, length[None], np.array([[0.5]]))
    assert shortening.active_n < 0.5 * capacity.active_n < 0.7 * stretching.active_n
    too_fast = force_capacity(ONE, length[None], np.array([[-3.0]]))
    assert too_fast.active_n == 0.0  # a muscle never pushes


def test_fitting_puts_the_longest_fibre_at_its_place_whatever_the_size_of_the_person():
    lengths = np.linspace(0.29, 0.33, 9)[:, None]
    for size in (0.8, 1.0, 1.3):
        fitted = ONE.fitted_to(size * lengths)
        fibre = force_capacity(fitted, size * lengths, np.zeros((9, 1))).fibre
        assert fibre.max() == pytest.approx(muscle.LONGEST_FIBRE, abs=1e-12)
        np.testing.assert_allclose(fibre, force_capacity(ONE.fitted_to(lengths), lengths, np.zeros((9, 1))).fibre)


def test_a_muscle_whose_tendon_would_be_slack_is_fitted_to_its_shortest_and_its_longest_length():
    lengths = np.array([[0.30], [0.26], [0.25]])  # one factor would give a tendon of 0.255 m
    fitted = replace(ONE, tendon_slack_length_m=np.array([0.6])).fitted_to(lengths)
    fibre = force_capacity(fitted, lengths, np.zeros((3, 1)))
    assert fitted.tendon_slack_length_m == pytest.approx(0.25)
    assert fibre.fibre.max() == pytest.approx(muscle.LONGEST_FIBRE, abs=1e-12)
    assert not fibre.slack.any()
    assert (fibre.active_n[:, 0] > 0.0).tolist() == [True, True, False]


def test_a_muscle_is_scaled_by_one_factor_as_long_as_that_leaves_its_tendon_taut():
    """No jump between the two rules: at the shortest length where both hold they give the same."""
    one_factor = ONE.fitted_to(np.array([[0.33]]))
    tendon = one_factor.tendon_slack_length_m[0]
    for shortest in (tendon + 1e-9, tendon - 1e-9):
        both = ONE.fitted_to(np.array([[0.33], [shortest]]))
        np.testing.assert_allclose(both.tendon_slack_length_m, one_factor.tendon_slack_length_m, rtol=1e-7)
        np.testing.assert_allclose(both.optimal_fibre_length_m, one_factor.optimal_fibre_length_m, rtol=1e-7)


def test_a_slack_tendon_gives_no_force_and_a_warning_that_names_it():
    lengths = np.array([[0.3], [0.198], [0.199], [0.29]])
    for pennation in (0.0, 0.3):
        muscles = replace(ONE, pennation_rad=np.array([pennation]))
        with pytest.warns(RuntimeWarning, match="one gives no force in 2 frames from 1 to 2: it is up to 2 mm shorter"):
            capacity = force_capacity(muscles, lengths, np.zeros((4, 1)))
        assert capacity.slack[:, 0].tolist() == [False, True, True, False]
        np.testing.assert_array_equal(capacity.active_n[1:3], 0.0)
        np.testing.assert_array_equal(capacity.passive_n[1:3], 0.0)
        assert capacity.active_n[[0, 3]].min() > 100.0


def test_isometric_muscles_give_their_greatest_force_at_any_length():
    capacity = force_capacity(ONE, np.array([[0.1], [0.5]]), np.zeros((2, 1)), "isometric")
    np.testing.assert_array_equal(capacity.active_n, 1000.0)
    np.testing.assert_array_equal(capacity.passive_n, 0.0)


def test_what_no_muscle_is_is_refused():
    with pytest.raises(ValueError, match=r"muscle one is at most 0.15 m long, never longer than its tendon of 0.2 m"):
        force_capacity(ONE, np.array([[0.14], [0.15]]), np.zeros((2, 1)))
    with pytest.raises(ValueError, match="muscle model is 'elastic', expected hill or isometric"):
        force_capacity(ONE, np.array([[0.3]]), np.zeros((1, 1)), "elastic")
    with pytest.raises(
        ValueError, match=r"optimal_fibre_length_m of one is -0\.1, expected more than 0 and less than 1 m"
    ):
        replace(ONE, optimal_fibre_length_m=np.array([-0.1]))
    with pytest.raises(ValueError, match="max_isometric_force_n of one is nan"):
        replace(ONE, max_isometric_force_n=np.array([np.nan]))
    with pytest.raises(ValueError, match=r"has shape \(1,\), expected a value for each of 2"):
        replace(ONE, names=("one", "two"))
    with pytest.raises(ValueError, match="expected each named once"):
        replace(ONE, names=("one", "one"))
