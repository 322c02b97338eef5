import numpy as np
import pytest

from casadi_contact.samples.domains import Envelopes
from casadi_contact.scenes.normal_load import normal_loads

# Two cycles, two frames. tx: 0..1 and 0..3 (widths 1, 3; mean 2).
# Fy_med: -100..-60 and -20..-20 (widths 40, 0; mean 20).
CURVES = [[[0.0, -100.0], [3.0, -20.0]], [[1.0, -60.0], [0.0, -20.0]]]
REFERENCE = Envelopes.over(("tx", "Fy_med"), CURVES)


@pytest.mark.parametrize(
    ("rule", "lower", "upper"),
    [
        ((0.0, 0.0), [[0, -100], [0, -20]], [[1, -60], [3, -20]]),
        ((0.2, 0.5), [[0 - 1.0, -100 - 8.0], [0 - 0.6, -20 - 10.0]], [[1 + 1.0, -60 + 8.0], [3 + 0.6, -20 + 10.0]]),
        ((1.0, 2.0), [[0 - 4.0, -100 - 40.0], [0 - 3.0, -20 - 40.0]], [[1 + 4.0, -60 + 40.0], [3 + 3.0, -20 + 40.0]]),
    ],
)
def test_frames_are_expanded_by_hand(rule, lower, upper):
    """The bounds; D1: ±20 % of the width, frames narrower than the mean width ±0.5 of that; D2: ±100 %, ±2."""
    box = REFERENCE.expand(*rule, {})
    np.testing.assert_allclose(box.lower, lower)
    np.testing.assert_allclose(box.upper, upper)
    d3 = REFERENCE.extremes(0.25, 2.0, {})  # 0..3 and -100..-20, by a quarter of their range
    np.testing.assert_allclose(d3.lower, [[-0.75, -120.0]])
    np.testing.assert_allclose(d3.upper, [[3.75, 0.0]])


def test_no_bound_pulls():
    """Fy_med of D2 reaches +20 N in frame 2 and -20 N in frame 1; 5 N of compression is the boundary."""
    pushing = REFERENCE.expand(1.0, 2.0, {}).without_pull(normal_loads(["Fy_med", "Fy_lat"], ["med", "lat"]), 5.0)
    np.testing.assert_allclose(pushing.upper, [[5.0, -20.0], [6.0, -5.0]])
    np.testing.assert_allclose(pushing.lower, [[-4.0, -140.0], [-3.0, -60.0]])


def test_an_input_with_the_same_curve_in_all_cycles_is_taken_to_differ_by_a_tenth_of_its_range():
    """rz goes from -1.0 to 0.2 in both cycles, a width of 0.12 rad; tz by 0.1 mm, a width of 1 mm; tx is measured."""
    curves = [[[0.0, -1.0, 0.0], [2.0, 0.2, 0.1]], [[1.0, -1.0, 0.0], [3.0, 0.2, 0.1]]]
    single = Envelopes.over(("tx", "rz", "tz"), curves)
    assert single.assumed_widths == pytest.approx({"rz": 0.12, "tz": 1.0})
    np.testing.assert_allclose(single.expand(0.2, 0.5, {}).upper[:, 1:], [[-0.94, 0.5], [0.26, 0.6]])
    np.testing.assert_allclose(single.expand(1.0, 2.0, {}).lower[:, 1:], [[-1.24, -2.0], [-0.04, -1.9]])
    np.testing.assert_allclose(single.extremes(0.25, 2.0, {}).upper, [[3.75, 0.2 + 0.3, 0.1 + 2.0]])
    np.testing.assert_allclose(single.expand(0.2, 0.5, {"rz": 0.02}).upper[:, 1], [-0.98, 0.22])


def test_cycles_that_differ_by_what_settling_leaves_count_as_the_same():
    noisy = Envelopes.over(("tx",), [[[0.0], [1e-5]], [[1e-5], [0.0]]])
    assert noisy.assumed_widths == {"tx": 1.0}
    np.testing.assert_allclose(noisy.expand(0.2, 0.5, {}).widths, 1.0, atol=1e-4)
    assert Envelopes.over(("tx",), [[[0.0], [0.0]], [[0.01], [0.01]]]).assumed_widths == {}


def test_an_input_that_never_changes_or_whose_width_is_the_same_in_all_frames():
    still = Envelopes.over(("tx",), np.zeros((2, 3, 1)))
    np.testing.assert_array_equal(still.extremes(0.25, 2.0, {"tx": 0.5}).upper, [[0.5]])
    np.testing.assert_array_equal(still.extremes(0.25, 2.0, {}).upper, [[2.0]])
    even = np.stack([np.zeros((101, 1)), np.full((101, 1), 0.3)])  # the mean of the widths differs in the last digit
    np.testing.assert_allclose(Envelopes.over(("tx",), even).expand(0.2, 0.5, {}).upper, 0.36)


def test_a_load_that_never_changes_varies_by_a_twentieth_of_the_largest_of_its_kind():
    """1,000 N and no N, one cycle: each by 50 N. Torques are of another kind: 2,000 N·mm by 100, and none by none."""
    still = np.array([[[-1000.0, 0.0, 2000.0]] * 3])
    assert Envelopes.over(("Fy", "Fz", "Tz"), still).assumed_widths == pytest.approx(
        {"Fy": 50.0, "Fz": 50.0, "Tz": 100.0}
    )
    assert Envelopes.over(("Fy", "Tz"), still[..., :2]).assumed_widths == {"Fy": 50.0, "Tz": 0.0}


def test_a_narrow_input_is_widened_about_its_middle_and_a_wide_one_is_kept():
    box = Envelopes(("tx", "tz"), np.array([[-4.0, 0.1]]), np.array([[6.0, 0.3]])).at_least({"tz": 3.0, "tx": 1.0})
    np.testing.assert_allclose(box.lower, [[-4.0, -1.3]])
    np.testing.assert_allclose(box.upper, [[6.0, 1.7]])
