"""Polynomial response surfaces of total degree 2 to 6, by least squares on scaled inputs.

    F(x) = Σ_k c_k·m_k(u),   u = (x - centre)/half range,   m_k = m_parent(k)·u_variable(k),   m_0 = 1

so a monomial costs one product. The derivatives of a polynomial are polynomials in the first of the same monomials:
their coefficients are found once, and the same compiled loop evaluates them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from casadi_contact.core.compilation import njit
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.peers.stopwatch import one_call, single_calls
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet

FAMILY = "polynomial"
DEGREES = (2, 3, 4, 5, 6)


@njit()
def _evaluate(u, parents, variables, coefficients, monomials, values):  # type: ignore[no-untyped-def]
    """values (m) = Σ_k coefficients[k]·monomial_k, into preallocated arrays."""
    monomials[0] = 1.0
    for j in range(values.size):
        values[j] = coefficients[0, j]
    for k in range(1, coefficients.shape[0]):
        monomial = monomials[parents[k]] * u[variables[k]]
        monomials[k] = monomial
        for j in range(values.size):
            values[j] += coefficients[k, j] * monomial


@njit()
def _evaluate_all(u, parents, variables, coefficients, values):  # type: ignore[no-untyped-def]
    monomials = np.empty(coefficients.shape[0])
    for i in range(u.shape[0]):
        _evaluate(u[i], parents, variables, coefficients, monomials, values[i])


class Monomials:
    """All monomials of six variables up to a total degree, lowest first, each with the product that gives it."""

    def __init__(self, degree: int) -> None:
        self.factors = [f for d in range(degree + 1) for f in combinations_with_replacement(range(6), d)]
        self.index = {factors: k for k, factors in enumerate(self.factors)}
        self.parents = np.array([self.index[f[:-1]] if f else 0 for f in self.factors])
        self.variables = np.array([f[-1] if f else 0 for f in self.factors])

    def __len__(self) -> int:
        return len(self.factors)

    def matrix(self, u: Array) -> Array:
        """Every monomial (columns) of every row of u (n, 6)."""
        columns = np.ones((len(u), len(self)), order="F")
        for k in range(1, len(self)):
            np.multiply(columns[:, self.parents[k]], u[:, self.variables[k]], out=columns[:, k])
        return columns

    def derivative(self, coefficients: Array, variable: int) -> Array:
        """Coefficients (terms, ...) of the derivative by one variable: d(u_j^e·rest) = e·u_j^(e-1)·rest."""
        result = np.zeros_like(coefficients)
        for k, factors in enumerate(self.factors):
            power = factors.count(variable)
            if power:
                lower = list(factors)
                lower.remove(variable)
                result[self.index[tuple(lower)]] += power * coefficients[k]
        return result


class Polynomial:
    """Loads (L) as polynomials of the pose; ``condition`` is that of the least-squares matrix."""

    def __init__(self, data: TrainingSet, degree: int) -> None:
        monomials = Monomials(degree)
        if len(data) < len(monomials):
            raise ValueError(f"degree {degree} has {len(monomials)} terms, more than the {len(data)} training samples")
        self.load_names, self._limits = data.load_names, data.limits
        low, high = data.poses.min(axis=0), data.poses.max(axis=0)
        self._shift, self._inverse = 0.5 * (low + high), 1.0 / np.where(high > low, 0.5 * (high - low), 1.0)
        u = (data.poses - self._shift) * self._inverse
        solution, _, _, singular = np.linalg.lstsq(monomials.matrix(u), data.loads, rcond=None)
        fit = np.asarray(solution, dtype=np.float64)
        self.condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")
        self.parameter_count = fit.size
        self._parents, self._variables = monomials.parents, monomials.variables
        self._terms = [len([f for f in monomials.factors if len(f) <= degree - d]) for d in range(3)]
        first: Array = np.stack([self._inverse[j] * monomials.derivative(fit, j) for j in range(6)], axis=-1)
        second = np.stack([self._inverse[j] * monomials.derivative(first, j) for j in range(6)], axis=-1)
        loads, (upper, lower) = len(self.load_names), np.triu_indices(6)
        tables = [fit, first.reshape(len(fit), -1), second[..., upper, lower].reshape(len(fit), -1)]
        self._tables = [np.ascontiguousarray(t[:terms]) for t, terms in zip(tables, self._terms, strict=True)]
        self._outputs = [np.empty(loads), np.empty(6 * loads), np.empty(21 * loads)]
        self._monomials, self._u = np.empty(len(monomials)), np.empty(6)
        self._full = np.empty((6, 6), dtype=int)
        self._full[upper, lower] = self._full[lower, upper] = np.arange(21)

    def _order(self, pose: Array, order: int) -> Array:
        np.subtract(pose, self._shift, out=self._u)
        np.multiply(self._u, self._inverse, out=self._u)
        output = self._outputs[order]
        _evaluate(self._u, self._parents, self._variables, self._tables[order], self._monomials, output)
        return output

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        u = (as_poses(poses) - self._shift) * self._inverse
        loads = np.empty((len(u), len(self.load_names)))
        _evaluate_all(u, self._parents, self._variables, self._tables[0], loads)
        return self._limits.hold(loads)

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose, in an array that the next call overwrites."""
        loads = self._order(pose, 0)
        return self._limits.hold(loads)

    def jacobian_one(self, pose: Array) -> Array:
        """d loads / d pose (L, 6) of one pose."""
        clamped = self._limits.beyond(self._order(pose, 0))
        jacobian = self._order(pose, 1).reshape(-1, 6)
        jacobian[clamped] = 0.0
        return jacobian

    def hessian_one(self, pose: Array, multipliers: Array) -> Array:
        """Second derivatives (6, 6) of multipliers·loads at one pose."""
        multipliers = np.where(self._limits.beyond(self._order(pose, 0)), 0.0, multipliers)
        return (multipliers @ self._order(pose, 2).reshape(-1, 21))[self._full]


def fit_gflop(samples: int, terms: int) -> float:
    """10⁹ operations of least squares by the singular value decomposition [Golub and Van Loan, §5.5: 2mn² + 11n³]."""
    return 1e-9 * (2.0 * samples * terms**2 + 11.0 * terms**3)


def polynomials(data: TrainingSet, gflop: float) -> Iterator[Candidate]:
    """One response surface for each degree that the number of samples allows, within the budget in all."""
    left = gflop
    for degree in DEGREES:
        name, terms = f"{FAMILY} {degree}", comb(degree + 6, 6)
        needed = fit_gflop(len(data), terms)
        if needed > left:
            failure = f"needs about {needed:.3g} Gflop, {left:.3g} of {gflop:.3g} are left"
            yield Candidate(name, FAMILY, None, samples=len(data), failure=failure)
            continue
        began = time.process_time()
        try:
            model = Polynomial(data, degree)
        except (ValueError, np.linalg.LinAlgError, MemoryError) as error:
            yield Candidate(name, FAMILY, None, samples=len(data), failure=str(error) or type(error).__name__)
            continue
        took = time.process_time() - began
        left -= needed
        model(data.poses[:1]), model.one(data.poses[0])  # compiles the loops, which is no part of any measured time
        multipliers = np.ones(len(data.load_names))
        yield Candidate(
            name,
            FAMILY,
            model,
            time_value=single_calls(model.one),
            time_jacobian=single_calls(model.jacobian_one),
            time_hessian=single_calls(lambda pose, m=model, w=multipliers: m.hessian_one(pose, w)),  # type: ignore[misc]
            time_batch=one_call(model),
            samples=len(data),
            training_seconds=took,
            parameters=model.parameter_count,
            remark=f"condition number {model.condition:.1e}, compiled loop{data.limits.remark}",
        )
