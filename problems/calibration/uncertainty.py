"""How well measurements determine the parameters: the Hessian of the least squares, reduced to them.

With A_k, B_k the derivatives of a frame's weighted load residuals by z and by δ_k, the Gauss-Newton Hessian over z and
all δ has the Schur complement

    H = Σ_k A_kᵀ (I + B_k B_kᵀ)⁻¹ A_k

whose inverse is the covariance of z (normal errors, residuals nearly linear over their spread). An eigenvector with an
eigenvalue below 1 is a direction that the data know no better than by one unit of z: a factor of e in the material,
1 mm or 1/25 rad of placement. Parameters that one unit along it moves by more than their deviation from all other
directions are not identifiable together; the deviation of the rest contains it, to first order: along an open
direction that bends, others may go on from there.

The covariance supposes that the model explains the data but for the stated errors. Then the sum of squares follows χ²
with its degrees of freedom; where it is larger than that explains, deviations are scaled by √(χ²/ν) (Birge ratio). A
parameter at a bound of its search has no deviation: the least squares has no minimum there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.stats import chi2

from casadi_contact.core.conventions import Array
from problems.calibration.problem import Calibration

_LEAST_EIGENVALUE = 1.0
_AT_BOUND = 1e-3  # of z
CHANCE = 1e-4  # of a sum of squares beyond `largest_misfit` where the stated deviations are right


@dataclass(frozen=True)
class Uncertainty:
    """deviation (m,): standard deviation of the parameters [MPa, mm, rad], infinite where not identifiable;
    correlation (m, m) of z, NaN there; tied: groups of names that the data do not tell apart (of one: not at all);
    at_bound: names of those that end at a bound of the search."""

    parameters: tuple[str, ...]
    deviation: Array
    correlation: Array
    tied: tuple[tuple[str, ...], ...]
    at_bound: tuple[str, ...] = ()

    @property
    def identifiable(self) -> np.ndarray:
        """True (m,) for parameters that the data determine."""
        return np.isfinite(self.deviation)


def reduced_hessian(problem: Calibration, z: Array, delta: Array) -> Array:
    """H (m, m) at z (m,) and δ (n, 6)."""
    parts = [ca.MX.sym(name, *problem.residuals.size_in(i)) for i, name in enumerate(("z", "delta", "pose", "load"))]
    off = problem.residuals(*parts)
    slopes = ca.Function("slopes", parts, [ca.jacobian(off, parts[0]), ca.jacobian(off, parts[1])])
    H = np.zeros((len(z), len(z)))
    for one, pose, load in zip(delta, problem.measured.poses, problem.measured.loads, strict=True):
        A, B = (np.asarray(part) for part in slopes(z, one, pose, load))
        H += A.T @ np.linalg.solve(np.eye(len(B)) + B @ B.T, A)
    return H


def degrees_of_freedom(problem: Calibration) -> int:
    """Measured loads less parameters, at least 1: every δ is an unknown with a residual of its own."""
    return max(problem.measured.loads.size - len(problem.parameters), 1)


def largest_misfit(problem: Calibration) -> float:
    """Sum of squares over its degrees of freedom that the stated deviations exceed by a chance of `CHANCE`."""
    freedom = degrees_of_freedom(problem)
    return float(chi2.isf(CHANCE, freedom)) / freedom


def uncertainty(problem: Calibration, z: Array, delta: Array, scale: float = 1.0) -> Uncertainty:
    """Standard deviations, times scale, and correlations at an estimate."""
    values, vectors = np.linalg.eigh(reduced_hessian(problem, z, delta))
    known = values >= _LEAST_EIGENVALUE
    apart = np.sqrt(np.sum(vectors[:, known] ** 2 / values[known], axis=1))  # from the known directions alone
    shares = np.abs(vectors[:, ~known].T) / np.maximum(apart, 1e-300)
    tied = tuple(_names(problem.parameters, share >= min(1.0, share.max())) for share in shares)
    covariance = (vectors / np.where(known, values, _LEAST_EIGENVALUE)) @ vectors.T
    m = len(problem.parameters)
    ends = np.minimum(z - problem.lower[:m], problem.upper[:m] - z) < _AT_BOUND
    free = ends | np.isin(problem.parameters, [name for group in tied for name in group])
    covariance[free], covariance[:, free] = np.nan, np.nan
    spread = np.sqrt(np.diag(covariance))
    size = np.where(problem.placing, problem.units, problem.values(z))
    deviation = np.where(free, np.inf, scale * spread * size)
    at_bound = tuple(name for name, end in zip(problem.parameters, ends, strict=True) if end)
    return Uncertainty(problem.parameters, deviation, covariance / np.outer(spread, spread), tied, at_bound)


def _names(parameters: Sequence[str], chosen: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, taken in zip(parameters, chosen, strict=True) if taken)
