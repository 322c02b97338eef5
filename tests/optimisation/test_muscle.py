"""Hill muscles with a rigid tendon: normalised curves, forces along the tendon, scaling to a person."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.optimisation import muscle
from casadi_contact.optimisation.muscle import MuscleParameters, rigid_tendon_forces

LENGTHS = np.linspace(0.4, 1.7, 27)
ONE = MuscleParameters(("one",), np.array([1000.0]), np.array([0.1]), np.array([0.2]), np.array([0.3]))


def test_curves_meet_their_definitions():
    np.testing.assert_allclose(muscle.force_velocity(np.array([-1.0, 0.0])), [0.0, 1.0], atol=1e-4)
    np.testing.assert_allclose(muscle.passive_force_length(np.array([0.2, 1.6])), [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(muscle.active_force_length(np.array([1.0])), 1.0, atol=0.01)
    assert muscle.active_force_length(LENGTHS).max() < 1.01
    assert muscle.force_velocity(np.array([1.0]))[0] == pytest.approx(1.794, abs=0.001)
    assert muscle.passive_force_length(np.array([muscle.LONGEST_FIBRE]))[0] == pytest.approx(0.07, abs=0.005)


def test_forces_of_a_pennate_muscle_follow_from_its_fibre():
    """F = F0·(f_l(l)·f_v(v) + f_p(l))·cos α with v = velocity·cos α/(v_max·L0): at 60 degrees a fibre shortens half as
    fast as its musculotendon."""
    pennate = replace(ONE, pennation_rad=np.array([np.pi / 3.0]))  # thickness L0·sin 60°
    length = 0.2 + 0.1 * np.cos(np.pi / 3.0)  # the fibre at its optimum
    for speed in (-0.4, 0.0, 0.3):
        found, passive, _ = rigid_tendon_forces(pennate, length, speed)
        v = 0.5 * speed / (10.0 * 0.1)
        active = 1000.0 * 0.5 * muscle.active_force_length(1.0) * muscle.force_velocity(v)
        assert found == pytest.approx(active, rel=1e-9)
        assert passive == pytest.approx(500.0 * muscle.passive_force_length(1.0), rel=1e-9)
    assert rigid_tendon_forces(pennate, length, -3.0)[0] == 0.0  # a muscle never pushes


def test_scaling_puts_the_longest_fibre_at_its_place_whatever_the_size_of_the_person():
    lengths = np.linspace(0.29, 0.33, 9)[:, None]
    for size in (0.8, 1.0, 1.3):
        fibre = rigid_tendon_forces(ONE.fitted_to(size * lengths), size * lengths, 0.0)[2]
        assert fibre.max() == pytest.approx(muscle.LONGEST_FIBRE, abs=1e-12)
        np.testing.assert_allclose(fibre, rigid_tendon_forces(ONE.fitted_to(lengths), lengths, 0.0)[2])


def test_a_tendon_that_would_be_slack_is_scaled_to_the_shortest_length_without_a_jump():
    lengths = np.array([[0.30], [0.26], [0.25]])  # one factor would give a tendon of 0.255 m
    fitted = replace(ONE, tendon_slack_length_m=np.array([0.6])).fitted_to(lengths)
    active, _, fibre = rigid_tendon_forces(fitted, lengths, 0.0)
    assert fitted.tendon_slack_length_m == pytest.approx(0.25)
    assert fibre.max() == pytest.approx(muscle.LONGEST_FIBRE, abs=1e-12)
    assert (active[:, 0] > 0.0).tolist() == [True, True, False]
    one_factor = ONE.fitted_to(np.array([[0.33]]))
    for shortest in one_factor.tendon_slack_length_m[0] + np.array([1e-9, -1e-9]):
        both = ONE.fitted_to(np.array([[0.33], [shortest]]))
        np.testing.assert_allclose(both.optimal_fibre_length_m, one_factor.optimal_fibre_length_m, rtol=1e-7)


def test_a_slack_tendon_gives_no_force():
    active, passive, _ = rigid_tendon_forces(ONE, np.array([0.3, 0.198, 0.199, 0.29]), 0.0)
    assert (active > 0.0).tolist() == (passive > 0.0).tolist() == [True, False, False, True]


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("optimal_fibre_length_m", [100.0], "mm"),
        ("pennation_rad", [11.0], "degrees"),
        ("max_isometric_force_n", [np.nan], "N"),
        ("names", ("one", "one"), "once"),
        ("names", ("one", "two"), "shape"),
    ],
)
def test_parameters_that_no_muscle_has_are_refused(field, value, word):
    with pytest.raises(ValueError, match=word):
        replace(ONE, **{field: value if field == "names" else np.array(value)})
