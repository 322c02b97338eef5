"""Each stopping criterion of §2.6 on hand-made histories, and stall detection."""

import pytest

from casadi_contact.networks.training.stopping import budget_used, error_reached, stalled, validation_rising

NAN = float("nan")


@pytest.mark.parametrize(
    ("training", "validation", "reached"),
    [(1.0, NAN, True), (1.1, NAN, False), (0.9, 1.0, True), (0.9, 1.1, False), (1.1, 0.9, False)],
)
def test_error_reached_on_training_and_validation_rows(training, validation, reached):
    assert error_reached(training, validation, tolerance=1.0) is reached


def test_the_budget_is_used_up_when_it_is_reached():
    assert budget_used(60.0, 60.0)
    assert not budget_used(59.9, 60.0)


@pytest.mark.parametrize(
    ("validation", "rising"),
    [
        ([5.0, 4.0, 4.1, 4.2, 4.3], True),
        ([5.0, 4.0, 4.1, 4.2], False),
        ([4.0, 4.1, 4.2, 4.1, 4.3, 4.4], False),  # not in a row
        ([4.0, 4.1, 4.1, 4.2, 4.2, 4.3], True),  # refused steps repeat a value
        ([4.0, 4.0, 4.0, 4.0, 4.0], False),
        ([NAN] * 9, False),
        ([], False),
    ],
)
def test_validation_rising_three_times_in_a_row(validation, rising):
    assert validation_rising(validation, 3) is rising


def test_stalled_over_a_window():
    assert stalled([9.0, 1.0, 0.9995, 0.999], window=2, least_improvement=2e-3)
    assert not stalled([9.0, 1.0, 0.9995, 0.99], window=2, least_improvement=2e-3)
    assert not stalled([1.0, 1.0], window=2, least_improvement=2e-3)
