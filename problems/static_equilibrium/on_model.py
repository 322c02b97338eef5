"""The same loads on another contact model, from where they are carried on the problem's own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import root

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from problems.static_equilibrium.balance import HELD, Balance
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.solve import EquilibriumResult

NEWTON_STEPS = 20


def on_model(
    problem: StaticEquilibrium, result: EquilibriumResult, model: ContactModel, rows: np.ndarray | None = None
) -> Array:
    """The poses (n, 6) at which another contact model carries the same loads, found from the surrogate's by Newton's
    shortest steps, which leave alone what nothing holds (a ball's rotation), or else by SciPy's Powell hybrid method,
    both with the model's Jacobian; NaN where none is found, and but for rows (n,), those solved if left out."""
    balance, starts = Balance.of(problem, model), problem.variables(result.poses)
    found = np.full_like(result.poses, np.nan)
    for row in map(int, np.flatnonzero(result.converged if rows is None else rows)):
        unbalanced, slopes = partial(balance.unbalanced_n, row), partial(balance.slopes, row)
        tolerance_n = float(problem.tolerance_n[row])
        q = _nearby(unbalanced, slopes, starts[row], tolerance_n)
        if q is None:
            q = root(unbalanced, starts[row], jac=slopes).x
        if np.abs(unbalanced(q)).max() <= tolerance_n:
            found[[row]] = problem.moved(problem.rest[[row]], q)
    return found


def _nearby(
    unbalanced: Callable[[Array], Array], slopes: Callable[[Array], Array], q: Array, tolerance_n: float
) -> Array | None:
    """The root that Newton's shortest steps lead to; None if it takes more than NEWTON_STEPS."""
    for _ in range(NEWTON_STEPS):
        off = unbalanced(q)
        if np.abs(off).max() <= tolerance_n:
            return q
        q = q - np.linalg.lstsq(slopes(q), off, rcond=HELD)[0]
    return None
