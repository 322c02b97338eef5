"""Are two evaluations of the same formula equal but for rounding, on any processor?

Instruction sets differ in fused products and in the order of sums, and each last digit is amplified by the formula:
near liftoff a load is a small difference of large numbers, so that its own size is no measure of its rounding error.
The measure is the usual size of that output: the largest it gets over the poses of a test. Two to three digits are
left above what was seen (5.8e-12 in values with AVX2, the reference computed by torch).
"""

from __future__ import annotations

import numpy as np

ROUNDING = (1e-10, 1e-9, 1e-8)  # of values, first and second derivatives, relative to the usual size of that output

# Trained two_stage networks add up last-layer terms of thousands of times their sum: so many times more rounding.
CANCELLED = {"patch": 1.0, "two_stage": 100.0}


def usual_size(values):
    """Largest magnitude (m,) of each output of values (n, m, ...) over poses and derivatives."""
    values = np.abs(np.asarray(values, dtype=float))
    return values.reshape(*values.shape[:2], -1).max(axis=(0, 2))


def agree(got, want, order=0, size=None, amplified=1.0):
    """Assert that got and want (n, m, ...), derivatives of an order, differ by rounding relative to the size (m,).

    size: `usual_size` of want if left out. amplified: how many times more than usual the formula amplifies rounding.
    """
    got, want = np.asarray(got, dtype=float), np.asarray(want, dtype=float)
    assert got.shape == want.shape
    size = usual_size(want) if size is None else size
    off = np.abs(got - want)
    allowed = amplified * ROUNDING[order] * np.reshape(size, (1, -1, *[1] * (want.ndim - 2)))
    wrong = ~(off <= allowed)  # NaN is wrong
    worst = np.unravel_index(np.argmax(np.where(wrong, off / np.maximum(allowed, 1e-300), 0.0)), off.shape)
    assert not wrong.any(), (
        f"{got[worst]!r} differs from {want[worst]!r} at {tuple(map(int, worst))} by {off[worst]:.2g}, "
        f"expected at most {np.broadcast_to(allowed, off.shape)[worst]:.2g}"
    )


def close(got, want, digits):
    """Assert that arrays of outputs of one size differ by 10^-digits of the largest entry and of their own."""
    got, want = np.asarray(got, dtype=float), np.asarray(want, dtype=float)
    np.testing.assert_allclose(got, want, rtol=10.0**-digits, atol=10.0**-digits * np.abs(want).max())
