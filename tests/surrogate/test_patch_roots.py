"""Root loads of patches from those of their parts: one scale with the load, smooth, and a way back into contact."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.surrogate.patch.formulas import union_roots
from casadi_contact.surrogate.patch.surrogate import patch_roots


def roots(least):
    """Root loads of two to four parts, none nearer to liftoff than ``least``."""
    return st.lists(st.floats(-3.0, 3.0).filter(lambda s: abs(s) > least), min_size=2, max_size=4)


def together(s):
    """S and dS/ds of one patch whose parts have the root loads s (n, k)."""
    s = np.atleast_2d(s)
    identity = np.broadcast_to(np.eye(s.shape[1]), (len(s), s.shape[1], s.shape[1]))
    root, slope = patch_roots(s, identity, [0, s.shape[1]])
    return root[:, 0], slope[:, 0]


@given(roots(1e-6))
def test_a_loaded_patch_has_the_root_of_its_parts_loads_a_free_one_that_of_about_the_nearest(s):
    root, slope = together(s)
    load = (np.maximum(s, 0.0) ** 2).sum()
    if load > 0.0:
        assert root[0] == pytest.approx(np.sqrt(load), rel=1e-12)
    else:
        assert max(s) <= root[0] < 0.0
        assert root[0] <= max(s) / np.sqrt(len(s)) * (1.0 - 1e-12)
        assert (slope > 0.0).any(), "a way back into contact"
    assert (slope >= 0.0).all(), "more load of a part is never less load of the patch"


@given(roots(1e-4))  # far enough from the bend for differences
def test_slopes_are_those_of_finite_differences_and_of_casadi(s):
    step = 1e-7
    steps = step * np.eye(len(s))
    difference = (together(s + steps)[0] - together(s - steps)[0]) / (2.0 * step)
    root, slope = together(s)
    np.testing.assert_allclose(slope[0], difference, atol=2e-5)
    symbols = ca.MX.sym("s", len(s))
    patch = union_roots(symbols, [0, len(s)])
    f = ca.Function("f", [symbols], [patch, ca.jacobian(patch, symbols)])
    np.testing.assert_allclose(float(f(s)[0]), root[0], rtol=1e-12)
    np.testing.assert_allclose(f(s)[1].full(), slope, atol=1e-12)


def test_root_and_slope_pass_on_smoothly_where_a_part_comes_into_contact():
    """From 1e-7 below to 1e-7 above: another part far off, or already loaded."""
    for other in (-0.8, 0.8):
        (before, after), slopes = together([[-1e-7, other], [1e-7, other]])
        assert after - before == pytest.approx(2e-7 if other < 0.0 else 0.0, abs=1e-12)
        np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-6)


def test_patches_of_one_part_keep_their_roots_and_parts_count_for_their_own_patch():
    s = np.array([[0.3, -0.4, 0.5, -2.0]])
    ds = np.random.default_rng(0).normal(size=(1, 4, 6))
    root, slope = patch_roots(s, ds, [0, 1, 3, 4])
    np.testing.assert_array_equal(root[0, [0, 2]], s[0, [0, 3]])
    np.testing.assert_array_equal(slope[0, [0, 2]], ds[0, [0, 3]])
    assert root[0, 1] == pytest.approx(0.5)
    np.testing.assert_allclose(slope[0, 1], ds[0, 2], rtol=1e-12)
    exact = union_roots(ca.MX(ca.DM(s.T)), [0, 1, 3, 4])
    np.testing.assert_allclose(np.asarray(ca.evalf(exact)).ravel(), root[0], rtol=1e-12)
