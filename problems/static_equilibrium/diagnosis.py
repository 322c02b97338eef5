"""Why rows were not solved: what the contact model itself says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.contact.model import ContactModel
from problems.common.learned_range import beyond_learned
from problems.static_equilibrium.on_model import on_model
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.pulls import pulls
from problems.static_equilibrium.solve import EquilibriumResult


def diagnose(problem: StaticEquilibrium, result: EquilibriumResult, model: ContactModel | str) -> EquilibriumResult:
    """The result with what the contact model finds, from the nearest pose, for each unsolved row that presses: an
    equilibrium outside of what was learned (by how much, in which parameter), one inside, or none.

    model: words where there is none (`own_model`): then the result stays as it is.
    """
    asked = ~result.converged & (pulls(problem) == "")
    if isinstance(model, str) or not asked.any():
        return result
    found = on_model(problem, result, model, asked)
    reason = result.reason.copy()
    for row in np.flatnonzero(asked):
        if np.isnan(found[row]).any():
            reason[row] += "; from there the contact model finds no equilibrium either"
        else:
            inside = "not found, though in the learned range" if np.isfinite(problem.lower).any() else "not found"
            where = beyond_learned(problem.model, found[row : row + 1])[0] or inside
            reason[row] = f"{where}: the contact model has an equilibrium; {reason[row]}"
    return replace(result, reason=reason)
