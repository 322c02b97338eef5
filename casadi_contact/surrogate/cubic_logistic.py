"""Logistic regression on cubic terms: the log of the odds that a sample is kept.

log(P(kept)/P(dropped)) = κ·φ(x),   φ: all products of at most three of the variables x
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import casadi as ca
import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from casadi_contact.core.conventions import Array

_RIDGE = 1e-3  # on the mean log-likelihood: keeps κ finite where both kinds are wholly apart


def _factors(count: int) -> list[tuple[int, ...]]:
    """The variables of every term: none, one, two, three of them."""
    return [chosen for size in range(4) for chosen in combinations_with_replacement(range(count), size)]


def cubic_terms(x: Array) -> Array:
    """φ (n, terms) of variables (n, k)."""
    return np.column_stack([np.prod(x[:, list(chosen)], axis=1) for chosen in _factors(x.shape[1])])


def cubic_expression(x: ca.MX) -> ca.MX:
    """φ (terms) of a column of variables (k) as a CasADi expression."""
    parts: list[ca.MX] = ca.vertsplit(x)
    terms: dict[tuple[int, ...], ca.MX] = {(): ca.MX(1.0)}
    for chosen in _factors(x.shape[0])[1:]:
        terms[chosen] = terms[chosen[:-1]] * parts[chosen[-1]]
    return ca.vertcat(*terms.values())


def logistic_coefficients(terms: Array, kept: np.ndarray) -> Array:
    """κ (m,) of the greatest likelihood for terms (n, m) and kept (n,), both kinds counting alike, with a ridge."""
    sign = np.where(kept, 1.0, -1.0)
    weight = np.where(kept, 0.5 / kept.sum(), 0.5 / (~kept).sum())
    free = np.r_[0.0, np.ones(terms.shape[1] - 1)]  # the constant is not held back

    def loss(coefficients: Array) -> tuple[float, Array]:
        margin = sign * (terms @ coefficients)
        value = weight @ np.logaddexp(0.0, -margin) + 0.5 * _RIDGE * (free * coefficients) @ coefficients
        gradient = -terms.T @ (weight * sign * expit(-margin)) + _RIDGE * free * coefficients
        return float(value), gradient

    def hessian(coefficients: Array) -> Array:
        odds = terms @ coefficients
        curvature = weight * expit(odds) * expit(-odds)
        return np.asarray((terms.T * curvature) @ terms + _RIDGE * np.diag(free))

    found = minimize(loss, np.zeros(terms.shape[1]), jac=True, hess=hessian, method="Newton-CG")
    return np.asarray(found.x)
