"""One rule says when errors are small enough: RMS of each load, and three times that for a single error."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.tolerance import Tolerance

TOLERANCE = Tolerance(("Fy", "Tx"), np.array([2.0, 50.0]))


@pytest.mark.parametrize(
    ("errors", "ratio"),
    [
        ([[2.0, 0.0], [-2.0, 0.0]], 1.0),  # the RMS is just met
        ([[0.0, 150.0], *[[0.0, 0.0]] * 15], 1.0),  # a single error of three tolerances, RMS 0.75
        ([[0.0, 300.0], *[[0.0, 0.0]] * 99], 2.0),
        ([[1.0, np.nan]], np.inf),
        (np.zeros((0, 2)), 0.0),
    ],
)
def test_the_ratio_is_that_of_the_worst_rms_or_single_error(errors, ratio):
    assert TOLERANCE.ratio(errors) == pytest.approx(ratio)
    assert TOLERANCE.met(errors) == (ratio <= 1.0)
    assert TOLERANCE.times(2.0).ratio(errors) == pytest.approx(ratio / 2.0)


def test_rows_are_met_one_by_one():
    np.testing.assert_array_equal(TOLERANCE.met_by_each([[6.0, 0.0], [6.1, 0.0], [0.0, np.nan]]), [True, False, False])


def test_a_scene_s_tolerance_is_in_the_order_of_the_names():
    scene = cc.load_scene("knee")
    tolerance = Tolerance.of(scene, ("Tx", "Fy_med"))
    assert tolerance.allowed.tolist() == [scene.tolerances["Tx"], scene.tolerances["Fy_med"]]


@pytest.mark.parametrize("given", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_a_tolerance_that_is_not_above_zero_is_refused(given):
    with pytest.raises(ValueError, match="above 0"):
        Tolerance.of_kinds(*given)
