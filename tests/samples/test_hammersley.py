import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.samples.domains import hammersley


def test_first_points_by_hand():
    expected = [[0, 0, 0], [1 / 4, 1 / 2, 1 / 3], [2 / 4, 1 / 4, 2 / 3], [3 / 4, 3 / 4, 1 / 9]]
    np.testing.assert_allclose(hammersley(4, 3), expected, atol=1e-15)


@given(st.integers(0, 300), st.integers(1, 7), st.integers(0, 5))
def test_points_lie_in_the_unit_box(count, dimensions, seed):
    shift = np.random.default_rng(seed).random(dimensions)
    for points in (hammersley(count, dimensions), hammersley(count, dimensions, shift)):
        assert points.shape == (count, dimensions)
        assert ((points >= 0.0) & (points < 1.0)).all()


@given(st.integers(0, 5), st.integers(0, 3))
def test_each_coordinate_meets_every_elementary_interval_once(binary_digits, ternary_digits):
    """n = 2^a·3^b points: every interval of length 2^-a (3^-b) holds exactly n/2^a (n/3^b) of them."""
    n = 2**binary_digits * 3**ternary_digits
    points = hammersley(n, 3)
    np.testing.assert_allclose(points[:, 0] * n, np.arange(n), atol=1e-9)
    for column, cells in ((1, 2**binary_digits), (2, 3**ternary_digits)):
        cell = np.floor(points[:, column] * cells + 1e-9).astype(int)
        assert (np.bincount(cell, minlength=cells) == n // cells).all()


@given(st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=4, max_size=4))
def test_a_shift_turns_the_torus(shift):
    moved = hammersley(50, 4, np.array(shift)) - hammersley(50, 4)
    difference = (moved - shift + 0.5) % 1.0 - 0.5
    assert np.abs(difference).max() < 1e-12
