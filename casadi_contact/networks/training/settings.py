"""What a fit may use and how it grows; when it stops: the three criteria of [EF15 §2.6], a fit that stands still, and a
trend that will miss the tolerance.

Histories are the root mean square of the training rows' weighted residuals, and the typical error of the validation
rows, one entry an iteration, in the unit of the tolerance (N or N·mm).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, isinf

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.training.weights import check_sizes


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of one network's fit.

    sizes: hidden layers to grow through, smallest first; a single entry trains that size without growth. On roots of
    contact loads three layers reach a given error sooner than two of as many weights.
    max_gflop: budget, shared by all sizes and restarts, in 10⁹ floating-point operations of matrix products. They are
    counted, not timed, so that a busy or slow machine stops at the same iteration with the same weights. A core of
    2023 does 5 to 35 Gflop a second, small networks being slowest. max_iterations: another end; with it growth goes
    by iterations instead. max_cpu_s: the clock of [EF15 §2.6] as a further end, CPU seconds of this thread; what a fit
    ends with then depends on the machine.
    max_validation_rises: criterion 3 of [EF15 §2.6]. restarts: how often a stalled fit begins again from another seed.
    stall_window, stall_improvement: stalled if the error falls by less than this share over so many iterations.
    checkpoint_every_s: a killed fit loses at most so much.
    """

    sizes: tuple[tuple[int, ...], ...] = ((8,), (12, 12), (16, 16, 16), (20, 20, 20), (24, 24, 24))
    activation: str = "algebraic"
    max_gflop: float = 5000.0
    max_iterations: int | None = None
    max_cpu_s: float = inf
    max_validation_rises: int = 50
    seed: int = 0
    restarts: int = 2
    stall_window: int = 60
    stall_improvement: float = 2e-3
    checkpoint_every_s: float = 5.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", check_sizes(self.sizes))
        activation_of(self.activation)
        for name in ("max_gflop", "max_cpu_s"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name)!r}, expected a number above 0")
        if self.max_iterations is None and isinf(self.max_gflop) and isinf(self.max_cpu_s):
            raise ValueError("no limit is set, expected an end to the fit: max_gflop, max_iterations or max_cpu_s")

    def gflop_at_end(self, gflop: float, cpu_s: float) -> float:
        """Work allotted to a fit that did gflop in cpu_s: max_gflop, or less if the clock ends it at this pace."""
        return min(self.max_gflop, gflop * self.max_cpu_s / cpu_s if cpu_s else inf)


ERROR_REACHED = "error reached"
BUDGET_USED = "budget used"
ITERATION_LIMIT = "iteration limit"
VALIDATION_RISING = "validation error rising"
STALLED = "stalled"
LIMITS = (BUDGET_USED, ITERATION_LIMIT)
"""Reasons after which the error might have fallen further."""


def error_reached(training_rms: float, squares: Array, domain: np.ndarray | None, tolerance: float) -> bool:
    """Criterion 1: training and validation error are at most the tolerance, that of each domain by itself, so that many
    easy rows do not hide a few that are far off. squares (n,), domain (n,): of validation rows, if any."""
    parts = [squares] if domain is None else [squares[domain == number] for number in np.unique(domain)]
    return training_rms <= tolerance and all(part.mean() <= tolerance**2 for part in parts if len(part))


def typical_error(squares: Array, tolerance: float) -> float:
    """√(exp(mean ln(r² + s²)) - s²) of rows with squared residuals r² (n,), s ten tolerances; NaN without rows.

    It is the RMS of rows that err by less than s, and of all where there is no tolerance. Where a few err by far more,
    the RMS is theirs alone: of a pose far from all others, or at a jump of the load, where a network that errs a tenth
    as much elsewhere may be worse.
    """
    if not len(squares):
        return np.nan
    if tolerance == 0.0:
        return float(np.sqrt(squares.mean()))
    scale = (10.0 * tolerance) ** 2
    return float(np.sqrt(max(np.exp(np.log(squares + scale).mean()) - scale, 0.0)))


def validation_rising(validation_error: Sequence[float], rises: int) -> bool:
    """Criterion 3: the validation error rose ``rises`` times in a row.

    Iterations without an accepted step repeat the last value; they neither rise nor break a row.
    """
    in_a_row = 0
    for before, after in zip(validation_error[-2::-1], validation_error[:0:-1], strict=False):
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


def extrapolated_error(effort: ArrayLike, rms: ArrayLike, end: float) -> float:
    """The error to expect at ``end``: log(rms) as a line in log(effort) through the latter half of the entries.

    Effort is the work (or iterations) since this size began, all > 0: errors of these fits fall like a power of it.
    The line never rises: a trend upwards counts as standing still.
    """
    effort, rms = np.asarray(effort, dtype=float), np.asarray(rms, dtype=float)
    half = len(rms) // 2
    x, y = np.log(effort[half:]), np.log(np.maximum(rms[half:], 1e-300))
    if len(x) < 2 or np.ptp(x) == 0.0:
        return float(rms[-1])
    power = min(float(np.polyfit(x, y, 1)[0]), 0.0)
    return float(rms[-1]) * (end / float(effort[-1])) ** power if end > effort[-1] else float(rms[-1])
