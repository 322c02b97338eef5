"""How well measurements determine the parameters: the Hessian of the least squares, reduced to them.

With A_k, B_k the derivatives of a frame's weighted load residuals by z and by δ_k, the Gauss-Newton Hessian over z and
all δ has the Schur complement

    H = Σ_k A_kᵀ (I + B_k B_kᵀ)⁻¹ A_k

whose inverse is the covariance of z (normal errors, residuals nearly linear over their spread). An eigenvector with an
eigenvalue below 1 is a direction that the data know no better than by one unit of z: a factor of e in the material,
1 mm or 1/25 rad of placement. Parameters that take part in it are not identifiable together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array
from problems.calibration.problem import Calibration

_LEAST_EIGENVALUE = 1.0
_TAKES_PART = 0.05  # component of an unknown direction


@dataclass(frozen=True)
class Uncertainty:
    """deviation (m,): standard deviation of the parameters [MPa, mm, rad], infinite where not identifiable;
    correlation (m, m) of z, NaN there; tied: groups of names that the data do not tell apart (of one: not at all)."""

    parameters: tuple[str, ...]
    deviation: Array
    correlation: Array
    tied: tuple[tuple[str, ...], ...]

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


def uncertainty(problem: Calibration, z: Array, delta: Array) -> Uncertainty:
    """Standard deviations and correlations at an estimate."""
    values, vectors = np.linalg.eigh(reduced_hessian(problem, z, delta))
    known = values >= _LEAST_EIGENVALUE
    tied = tuple(_names(problem.parameters, vector) for vector in vectors[:, ~known].T)
    covariance = (vectors[:, known] / values[known]) @ vectors[:, known].T
    free = np.isin(problem.parameters, [name for group in tied for name in group])
    covariance[free], covariance[:, free] = np.nan, np.nan
    spread = np.sqrt(np.diag(covariance))
    size = np.where(problem.placing, problem.units, problem.values(z))
    deviation = np.where(free, np.inf, spread * size)
    return Uncertainty(problem.parameters, deviation, covariance / np.outer(spread, spread), tied)


def _names(parameters: Sequence[str], vector: Array) -> tuple[str, ...]:
    return tuple(name for name, part in zip(parameters, vector, strict=True) if abs(part) > _TAKES_PART)
