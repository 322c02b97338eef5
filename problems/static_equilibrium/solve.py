"""The solution of settling under six loads."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import LEVER_MM, Array
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.joint_mechanics import total_selection
from casadi_contact.optimisation.starts import press_together, start_or_default
from problems.common.learned_range import held_beyond
from problems.static_equilibrium.balance import Balance
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.pulls import passes_beside, pulls

NOT_NEEDED = "Not_Needed"  # in place of IPOPT's status, where no row is left to solve


@dataclass(frozen=True)
class EquilibriumResult:
    """Poses (n, 6), contact wrench there (n, 6), misfit r/L (n, free) [N], and what became of each row."""

    poses: Array
    wrenches: Array
    misfit_n: Array
    converged: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float


def solve(
    problem: StaticEquilibrium, start: ArrayLike | None = None, max_iterations: int = 300, print_level: int = 0
) -> EquilibriumResult:
    """Solve with IPOPT from a start (n, 6), the rest poses if left out.

    A start may be anywhere: it is brought into the learned range, and what is sensitive is settled under the patches'
    shares of the loads (`press_together`).

    Never raises for loads that no pose carries: each row is reported with its misfit and the reason. Rows whose loads
    contact cannot carry in any pose (`pulls`) stay at their start.
    """
    began = time.perf_counter()
    poses = start_or_default(start, problem.rest)
    reason, outcome = pulls(problem), IpoptOutcome(NOT_NEEDED, 0)
    rows = np.flatnonzero(reason == "")
    if len(rows):
        poses[rows], reason[rows], outcome = _sought(problem.of_rows(rows), poses[rows], max_iterations, print_level)
    return EquilibriumResult(
        poses=poses,
        wrenches=problem.model(poses) @ total_selection(problem.model.load_names, problem.model.patch_names).T,
        misfit_n=problem.misfit_n(poses),
        converged=reason == "",
        reason=reason,
        ipopt_status=outcome.status,
        iterations=outcome.iterations,
        seconds=time.perf_counter() - began,
    )


def _sought(
    problem: StaticEquilibrium, poses: Array, max_iterations: int, print_level: int
) -> tuple[Array, np.ndarray, IpoptOutcome]:
    """Poses (n, 6) from a start, and why a row is not in equilibrium there, (n,)."""
    pressed = press_together(problem.model, poses, problem.rest, problem.loads, problem.free)
    options = ipopt_options(max_iterations=max_iterations, print_level=print_level)
    solver = ca.nlpsol("static_equilibrium", "ipopt", problem.nlp, options)
    x0 = np.clip(problem.variables(pressed).ravel(), problem.lower, problem.upper)
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper)
    found = problem.moved(pressed, np.asarray(answer["x"]).reshape(len(poses), -1))
    outcome = IpoptOutcome.of(solver)
    return found, _reasons(problem, pressed, found, outcome), outcome


def _reasons(problem: StaticEquilibrium, pressed: Array, poses: Array, outcome: IpoptOutcome) -> np.ndarray:
    """Why rows are not in equilibrium in poses (n, 6), found from pressed ones; "" where they are."""
    held = held_beyond(problem.model, poses, problem.columns)
    misfit, reason = problem.misfit_n(poses), np.full(len(poses), "", dtype=object)
    off = ~(np.abs(misfit).max(axis=1) <= problem.tolerance_n)  # as where a load is no number
    if not off.any():
        return reason
    balance, beside = Balance.of(problem, problem.model), passes_beside(problem, poses)
    for row in map(int, np.flatnonzero(off)):
        worst = int(np.abs(misfit[row]).argmax())
        unbalanced = three_digits(misfit[row, worst])
        left = f"{problem.free[worst]} is unbalanced by {unbalanced} N (torques over {LEVER_MM:g} mm)"
        if held[row]:
            reason[row] = f"{held[row]}: at the nearest {left}"
        elif loose := balance.loose(row, pressed[row]):
            reason[row] = (
                f"nothing holds {' and '.join(loose)} against the given loads, expected contact or a spring that does: "
                f"at the nearest {left}"
            )
        elif not outcome.solved:
            reason[row] = f"IPOPT stopped: {outcome.status}; {left}"
        else:
            where = " in the learned range" if np.isfinite(problem.lower).any() else ""
            reason[row] = f"not found{where}: at the nearest {left}{beside[row] and '; '}{beside[row]}"
    return reason
