"""The solution of settling under six loads, and the same on another contact model."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import LEVER_MM, WRENCH_NAMES, Array
from casadi_contact.optimisation import (
    KNEE_STEPS,
    IpoptOutcome,
    ipopt_options,
    press_together,
    start_or_default,
    total_selection,
    wrench_function,
)
from problems.common.learned_range import held_beyond
from problems.static_equilibrium.problem import TOLERANCE_N, StaticEquilibrium, residual_function

NEWTON_STEPS = 20
HELD = 1e-6  # share of the stiffest direction's stiffness below which one counts as held by nothing


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

    Never raises for loads that no pose carries: each row is reported with its misfit and the reason.
    """
    began = time.perf_counter()
    poses = start_or_default(start, problem.rest)
    poses = press_together(problem.model, poses, problem.rest, problem.loads, problem.free)
    columns = problem.columns
    options = ipopt_options(max_iterations=max_iterations, print_level=print_level)
    solver = ca.nlpsol("static_equilibrium", "ipopt", problem.nlp, options)
    x0 = np.clip((poses / KNEE_STEPS)[:, columns].ravel(), problem.lower, problem.upper)
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper)
    outcome = IpoptOutcome.of(solver)
    q = np.asarray(answer["x"]).reshape(len(columns), -1, order="F")
    poses[:, columns] = q.T * KNEE_STEPS[columns]
    poses = problem.model.scene.pose_space.onto(poses)
    misfit = np.asarray(problem.residuals(q)).T
    converged = np.abs(misfit).max(axis=1) <= TOLERANCE_N
    return EquilibriumResult(
        poses=poses,
        wrenches=problem.model(poses) @ total_selection(problem.model.load_names, problem.model.patch_names).T,
        misfit_n=misfit,
        converged=converged,
        reason=_reasons(problem, poses, misfit, converged, outcome),
        ipopt_status=outcome.status,
        iterations=outcome.iterations,
        seconds=time.perf_counter() - began,
    )


def on_model(
    problem: StaticEquilibrium, result: EquilibriumResult, model: ContactModel, rows: np.ndarray | None = None
) -> Array:
    """The poses (n, 6) at which another contact model carries the same loads, found from the surrogate's by Newton's
    shortest steps, which leave alone what nothing holds (a ball's rotation), or else by SciPy's Powell hybrid method,
    both with the model's Jacobian; NaN where none is found, and but for rows (n,), those solved if left out."""
    columns = problem.columns
    contact = wrench_function(model)
    residual, slope = _balance(problem, contact)
    found = np.full_like(result.poses, np.nan)
    for row in np.flatnonzero(result.converged if rows is None else rows):
        given = (problem.loads[row], problem.rest[row])

        def unbalanced(q: Array, given: tuple[Array, Array] = given) -> Array:
            return np.asarray(residual(q, *given)).ravel()

        def slopes(q: Array, given: tuple[Array, Array] = given) -> Array:
            return np.asarray(slope(q, *given))

        start = result.poses[row, columns] / KNEE_STEPS[columns]
        answer = _nearby(unbalanced, slopes, start)
        if answer is None:
            answer = root(unbalanced, start, jac=slopes).x
        if np.abs(unbalanced(answer)).max() <= TOLERANCE_N:
            found[row] = problem.rest[row]
            found[row, columns] = answer * KNEE_STEPS[columns]
    return problem.model.scene.pose_space.onto(found)


def held_moves(problem: StaticEquilibrium, poses: Array, moves: Array) -> Array:
    """Of moves (n, 6) away from poses (n, 6) the part that contact or springs hold: a ball may turn in its cup."""
    columns, contact, held = problem.columns, wrench_function(problem.model), np.zeros_like(moves)
    _, slope = _balance(problem, contact)
    for row, (pose, move) in enumerate(zip(poses, moves, strict=True)):
        stiffness = np.asarray(slope(pose[columns] / KNEE_STEPS[columns], problem.loads[row], problem.rest[row]))
        moved = stiffness @ (move[columns] / KNEE_STEPS[columns])
        held[row, columns] = np.linalg.lstsq(stiffness, moved, rcond=HELD)[0] * KNEE_STEPS[columns]
    return held


def _balance(problem: StaticEquilibrium, contact: ca.Function) -> tuple[ca.Function, ca.Function]:
    """What is unbalanced by the free parameters in `KNEE_STEPS`, the loads and the rest pose, and its slope; the caller
    keeps the contact's wrenches alive."""
    space = problem.model.scene.pose_space
    residual = residual_function(contact, problem.free, problem.about, problem.stiffness, space)
    q, loads, rest = (ca.MX.sym(name, size) for name, size in (("q", len(problem.columns)), ("loads", 6), ("rest", 6)))
    return residual, ca.Function("slope", [q, loads, rest], [ca.jacobian(residual(q, loads, rest), q)])


def _nearby(unbalanced: Callable[[Array], Array], slopes: Callable[[Array], Array], q: Array) -> Array | None:
    """The root that Newton's shortest steps lead to; None if it takes more than NEWTON_STEPS."""
    for _ in range(NEWTON_STEPS):
        off = unbalanced(q)
        if np.abs(off).max() <= TOLERANCE_N:
            return q
        q = q - np.linalg.lstsq(slopes(q), off, rcond=HELD)[0]
    return None


def _reasons(
    problem: StaticEquilibrium, poses: Array, misfit: Array, converged: np.ndarray, outcome: IpoptOutcome
) -> np.ndarray:
    held = held_beyond(problem.model, poses, problem.columns)
    reason = np.full(len(misfit), "", dtype=object)
    from_above = {(normal.component, normal.sign) for normal in problem.model.scene.normal_loads} == {("Fy", -1.0)}
    for row in np.flatnonzero(~converged):
        worst = int(np.abs(misfit[row]).argmax())
        left = f"{problem.free[worst]} is unbalanced by {misfit[row, worst]:.3g} N (torques over {LEVER_MM:g} mm)"
        if from_above and problem.loads[row, WRENCH_NAMES.index("Fy")] >= 0.0:
            reason[row] = f"Fy does not press the bodies together (compression is negative); {left}"
        elif held[row]:
            reason[row] = f"{held[row]}: at the nearest {left}"
        elif not outcome.solved:
            reason[row] = f"IPOPT stopped: {outcome.status}; {left}"
        else:
            where = " in the learned range" if np.isfinite(problem.lower).any() else ""
            reason[row] = f"not found{where}: at the nearest {left}"
    return reason
