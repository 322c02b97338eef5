"""Rows of a table that contradict the others, told before networks bend towards them: slips of a decimal point, runs
that did not converge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from casadi_contact.conventions import WRENCH_NAMES, Array
from casadi_contact.dataset.samples import Samples
from casadi_contact.quantities import quantity

_SHARE = 0.95  # of the residuals, which odd rows exceed
_TIMES = 8.0  # so many times: the largest residual of even noise is 2 to 4 times that share's
_LEAST = 0.02  # of a load, RMS: rows need not be more alike
_WRONG = 0.2  # of itself or of what is expected, by which an odd load differs at least: a cubic may miss a deep contact
_DEGREE = 3
_ROWS_PER_TERM = 4
_ROUNDS = 20
_NAMED = 5


@dataclass(frozen=True)
class OddRow:
    """A row by its number (from 1), its load [N, N·mm] that is odd, and what the others lead to expect."""

    row: int
    load: str
    unit: str
    value: float
    expected: float

    def __str__(self) -> str:
        return f"{self.row} ({self.load} {self.value:.3g} {self.unit}, by the others {self.expected:.3g})"


def odd_rows(samples: Samples) -> list[OddRow]:
    """Rows in contact with a load that is more than eight times as far as 95 % of the others from what a polynomial of
    the pose says, and by more than a fifth of itself, the oddest first, each with its oddest load.

    Of each part the root √N of the normal load and the other components W over N, which are smooth in the pose, are
    fitted by least absolute deviations, min Σ w·|y - A·c| with w = 1 for √N and w = N for W/N: a few wrong rows do not
    move such a fit. The degree is 3, or less where there are fewer than 4 rows for each term.

    Where N is odd, w is the lesser of N and its fit, and W is odd only beside the fit too: of a row whose normal load
    alone is wrong W/N is, and W is not.
    """
    scene = samples.scene
    oddest: dict[int, tuple[float, OddRow]] = {}
    for p, part in enumerate(scene.parts):
        wrench = samples.wrenches[:, p]
        rows = np.flatnonzero(part.normal.of(wrench) > 0.0)
        terms = _polynomial(samples.poses[rows][:, list(scene.pose_space.free)])
        if terms is None:
            continue
        normal, alone = part.normal.of(wrench[rows]), len(scene.parts) == 1
        root = _least_deviations(terms, np.sqrt(normal), np.ones(len(rows)))
        pressing = "normal load" if alone else f"normal load of {part.name}"
        times = np.where(_wrong(normal, root**2), _times_usual(np.sqrt(normal), root), 0.0)
        found = [(pressing, "N", normal, root**2, times)]
        carried = np.where(times > _TIMES, root**2, normal)
        for k, name in enumerate(WRENCH_NAMES):
            if name != part.normal.component:
                load = wrench[rows, k]
                ratio = _least_deviations(terms, load / normal, np.minimum(normal, carried))
                column = name if alone else f"{name}_{part.name}"
                wrong = _wrong(load, ratio * normal) & _wrong(load, ratio * carried)
                times = np.where(wrong, _times_usual(load, ratio * normal), 0.0)
                found.append((column, quantity(name).unit, load, ratio * carried, times))
        for load_name, unit, values, expected, times in found:
            for j in np.flatnonzero(times > _TIMES):
                odd = OddRow(int(rows[j]) + 1, load_name, unit, float(values[j]), float(expected[j]))
                if odd.row not in oddest or oddest[odd.row][0] < times[j]:
                    oddest[odd.row] = (float(times[j]), odd)
    return [odd for _, odd in sorted(oddest.values(), key=lambda one: -one[0])]


def odd_rows_text(rows: Sequence[OddRow]) -> str:
    """One line that names the oddest; empty for none."""
    if not rows:
        return ""
    named = ", ".join(map(str, rows[:_NAMED]))
    more = f" and {len(rows) - _NAMED} more" if len(rows) > _NAMED else ""
    return f"rows unlike what the others say, mend or remove them if they are wrong: {named}{more}"


def _polynomial(poses: Array) -> Array | None:
    """Terms (n, t) of the highest degree up to 3 that so many poses (n, k) can tell; None for too few of them."""
    varied = poses[:, np.ptp(poses, axis=0) > 0.0] if len(poses) else poses
    count, columns = varied.shape
    degrees = [d for d in range(1, _DEGREE + 1) if count >= _ROWS_PER_TERM * comb(columns + d, d)]
    if not degrees or not columns:
        return None
    x = (varied - varied.mean(axis=0)) / np.ptp(varied, axis=0)
    chosen = (c for d in range(degrees[-1] + 1) for c in combinations_with_replacement(range(columns), d))
    return np.column_stack([x[:, list(c)].prod(axis=1) for c in chosen])


def _least_deviations(terms: Array, values: Array, weights: Array) -> Array:
    """Fitted values (n,) of min Σ weights·|values - terms·c|, by squares weighted anew in each round."""
    squares = weights**2
    for _ in range(_ROUNDS):
        weighted = terms * squares[:, None]
        fitted = terms @ np.linalg.lstsq(weighted.T @ terms, weighted.T @ values, rcond=None)[0]
        off = np.abs(values - fitted)
        squares = weights / np.maximum(off, 1e-3 * np.median(off) + 1e-300)
    return np.asarray(fitted)


def _wrong(values: Array, expected: Array) -> np.ndarray:
    """Where values (n,) differ from what is expected by more than a fifth of either."""
    return np.asarray(np.abs(values - expected) > _WRONG * np.maximum(np.abs(values), np.abs(expected)))


def _times_usual(values: Array, fitted: Array) -> Array:
    """|values - fitted| (n,) over what 95 % of them stay below, or over 2 % of the fitted values' RMS if more."""
    off = np.abs(values - fitted)
    usual = max(float(np.quantile(off, _SHARE)), _LEAST * float(np.sqrt(np.mean(fitted**2))))
    return off / usual if usual > 0.0 else np.zeros_like(off)
