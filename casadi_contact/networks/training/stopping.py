"""When to stop: the three criteria of §2.6, and a fit that stands still.

History columns are the root-mean-square weighted residuals of the training and validation rows, one entry an
iteration, in the unit of the tolerance (N or N·mm).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from casadi_contact.core.conventions import Array

ERROR_REACHED = "error reached"
BUDGET_USED = "budget used"
ITERATION_LIMIT = "iteration limit"
VALIDATION_RISING = "validation error rising"
STALLED = "stalled"
# The error might have fallen further; surrogate files of before say "time used".
LIMITS = (BUDGET_USED, ITERATION_LIMIT, "time used")


def error_reached(training_rms: float, validation_rms: float, tolerance: float) -> bool:
    """Criterion 1: the training error is at most the wanted one - and so is the validation error, where there are
    validation rows (NaN without), lest a network too large for its data counts as good."""
    return training_rms <= tolerance and not validation_rms > tolerance


def reached_in_every_domain(
    residuals: Array, validation: np.ndarray, domain: np.ndarray | None, tolerance: float
) -> bool:
    """Criterion 1 in each domain by itself: root mean square of its validation rows at most the wanted one, lest many
    easy rows hide a few that are far off. residuals (n,) or (n, m); True without domains."""
    if domain is None:
        return True
    squares = np.reshape(residuals**2, (len(residuals), -1)).sum(axis=1)
    rows = [validation & (domain == number) for number in np.unique(domain[validation])]
    return all(bool(squares[chosen].mean() <= tolerance**2) for chosen in rows)


def budget_used(gflop: float, max_gflop: float) -> bool:
    """Criterion 2, the paper's allotted time counted as work."""
    return gflop >= max_gflop


def validation_rising(validation_rms: Sequence[float], rises: int) -> bool:
    """Criterion 3: the validation error rose ``rises`` times in a row.

    Iterations that changed nothing (a refused step) repeat the last value; they neither rise nor break a row.
    """
    in_a_row = 0
    for before, after in zip(validation_rms[-2::-1], validation_rms[:0:-1], strict=False):
        if after == before:
            continue
        if not after > before:
            return False
        in_a_row += 1
        if in_a_row >= rises:
            return True
    return False


def stalled(training_rms: Sequence[float], window: int, least_improvement: float) -> bool:
    """True if the error fell by less than a share ``least_improvement`` over the last ``window`` iterations."""
    if len(training_rms) <= window:
        return False
    before, now = training_rms[-1 - window], training_rms[-1]
    return isfinite(before) and before - now < least_improvement * before
