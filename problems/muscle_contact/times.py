"""Whether curves reach over the times of inverse dynamics: beyond their ends nothing is known of them."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import Array


def check_covers(what: str, time_s: Array, needed_s: Array) -> None:
    """ValueError where curves at rising times time_s (k,) [s] leave out more than one of their own steps at an end of
    needed_s (n,), the times of inverse dynamics; what: the file or cycle that they are of."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if needed_s[0] < time_s[0] - step or needed_s[-1] > time_s[-1] + step:
        raise ValueError(
            f"{what} reaches from {time_s[0]:g} to {time_s[-1]:g} s, inverse dynamics from {needed_s[0]:g} to "
            f"{needed_s[-1]:g} s: expected curves over all of it; cut inverse dynamics to the times of both, or give "
            "both the same zero of time"
        )


def at_times(what: str, time_s: Array, curves: Array, needed_s: Array) -> Array:
    """Curves (k, c) at the times needed_s, (n, c), by straight lines, and held where they end up to a step earlier.

    Raises ValueError as `check_covers`.
    """
    check_covers(what, time_s, needed_s)
    return np.column_stack([np.interp(needed_s, time_s, curve) for curve in curves.T])
