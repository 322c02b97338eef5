"""Widening keeps the function, and the trend tells when to grow."""

import numpy as np
import pytest

from casadi_contact.networks.training.growth import check_ladder, extrapolated_error, widen, will_reach
from casadi_contact.networks.training.weights import initial_network
from tests.support.regressions import smooth


def small(hidden=(4,), activation="algebraic"):
    data = smooth()
    return initial_network(data.inputs, data.targets, hidden, activation, seed=5), data.inputs


@pytest.mark.parametrize("activation", ["algebraic", "tanh"])
@pytest.mark.parametrize(("hidden", "wide"), [((4,), (7,)), ((4, 3), (6, 5)), ((4, 3, 2), (4, 6, 3))])
def test_widening_keeps_the_function_exactly(hidden, wide, activation):
    network, x = small(hidden, activation)
    wider = widen(network, wide, seed=0)
    assert wider.hidden == wide
    np.testing.assert_allclose(wider.value(x), network.value(x), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("hidden", [(4, 4), (5, 6, 7), (3,)])
def test_only_more_neurons_in_as_many_layers_are_widening(hidden):
    with pytest.raises(ValueError, match=r"cannot widen|expected each to be wider"):
        widen(small((4,))[0], hidden, seed=0)


def test_an_error_falling_as_a_power_of_time_is_extrapolated():
    seconds = np.arange(1.0, 51.0)
    assert extrapolated_error(seconds, 8.0 / seconds**0.5, end=200.0) == pytest.approx(8.0 / 200.0**0.5)
    assert will_reach(seconds, 8.0 / seconds**0.5, end=200.0, tolerance=0.6)
    assert not will_reach(seconds, 8.0 / seconds**0.5, end=200.0, tolerance=0.5)


def test_a_rising_trend_counts_as_standing_still():
    seconds = np.arange(1.0, 51.0)
    assert extrapolated_error(seconds, 1.0 + 0.01 * seconds, end=100.0) == pytest.approx(1.5)


@pytest.mark.parametrize("sizes", [(), ((),), ((0,),), ((8,), (6,)), ((8, 8), (20,)), ((8,), (8,))])
def test_sizes_that_do_not_contain_each_other_are_refused(sizes):
    with pytest.raises(ValueError, match="sizes"):
        check_ladder(sizes)
