"""Each stopping criterion of [EF15 §2.6] on hand-made histories, stall detection and the trend of an error."""

import numpy as np
import pytest

from casadi_contact.networks.training.settings import (
    TrainingSettings,
    error_reached,
    extrapolated_error,
    stalled,
    validation_rising,
)

NAN = float("nan")


@pytest.mark.parametrize(
    ("training", "validation", "reached"),
    [(1.0, NAN, True), (1.1, NAN, False), (0.9, 1.0, True), (0.9, 1.1, False), (1.1, 0.9, False)],
)
def test_error_reached_on_training_and_validation_rows(training, validation, reached):
    assert error_reached(training, validation, tolerance=1.0) is reached


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


def test_an_error_falling_as_a_power_of_effort_is_extrapolated_and_a_rising_one_stands_still():
    effort = np.arange(1.0, 51.0)
    assert extrapolated_error(effort, 8.0 / effort**0.5, end=200.0) == pytest.approx(8.0 / 200.0**0.5)
    assert extrapolated_error(effort, 1.0 + 0.01 * effort, end=100.0) == pytest.approx(1.5)


@pytest.mark.parametrize("sizes", [(), ((0,),), ((8,), (6,)), ((8, 8), (20,)), ((8,), (8,))])
def test_sizes_that_do_not_contain_each_other_are_refused(sizes):
    with pytest.raises(ValueError, match="sizes"):
        TrainingSettings(sizes=sizes)
