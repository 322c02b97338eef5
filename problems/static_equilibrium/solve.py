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
from casadi_contact.conventions import LEVER_MM, Array
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
from problems.static_equilibrium.problem import StaticEquilibrium, residual_function
from problems.static_equilibrium.pulls import pulls

NEWTON_STEPS = 20
NOT_NEEDED = "Not_Needed"  # in place of IPOPT's status, where no row is left to solve
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

    Never raises for loads that no pose carries: each row is reported with its misfit and the reason. Rows whose loads
    contact cannot carry in any pose (`pulls`) stay at their start.
    """
    began = time.perf_counter()
    poses = start_or_default(start, problem.rest)
    reason, outcome = pulls(problem), IpoptOutcome(NOT_NEEDED, 0)
    rows = np.flatnonzero(reason == "")
    if len(rows):
        poses[rows], reason[rows], outcome = _sought(problem.of_rows(rows), poses[rows], max_iterations, print_level)
    misfit = _misfit(problem, poses)
    return EquilibriumResult(
        poses=poses,
        wrenches=problem.model(poses) @ total_selection(problem.model.load_names, problem.model.patch_names).T,
        misfit_n=misfit,
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
    columns = problem.columns
    options = ipopt_options(max_iterations=max_iterations, print_level=print_level)
    solver = ca.nlpsol("static_equilibrium", "ipopt", problem.nlp, options)
    x0 = np.clip((pressed / KNEE_STEPS)[:, columns].ravel(), problem.lower, problem.upper)
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper)
    found = pressed.copy()
    found[:, columns] = np.asarray(answer["x"]).reshape(-1, len(columns)) * KNEE_STEPS[columns]
    found = problem.model.scene.pose_space.onto(found)
    outcome = IpoptOutcome.of(solver)
    return found, _reasons(problem, pressed, found, outcome), outcome


def _misfit(problem: StaticEquilibrium, poses: Array) -> Array:
    """r/L (n, free) [N] in poses (n, 6)."""
    return np.asarray(problem.residuals((poses / KNEE_STEPS)[:, problem.columns].T)).T


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
        tolerance = float(problem.tolerance_n[row])
        answer = _nearby(unbalanced, slopes, start, tolerance)
        if answer is None:
            answer = root(unbalanced, start, jac=slopes).x
        if np.abs(unbalanced(answer)).max() <= tolerance:
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


def _nearby(
    unbalanced: Callable[[Array], Array], slopes: Callable[[Array], Array], q: Array, tolerance: float
) -> Array | None:
    """The root that Newton's shortest steps lead to; None if it takes more than NEWTON_STEPS."""
    for _ in range(NEWTON_STEPS):
        off = unbalanced(q)
        if np.abs(off).max() <= tolerance:
            return q
        q = q - np.linalg.lstsq(slopes(q), off, rcond=HELD)[0]
    return None


def _loose(problem: StaticEquilibrium, row: int, pose: Array) -> list[str]:
    """The free parameters along which something is left over in a pose (6) in contact that no move of it changes: a
    ball's torque about its centre."""
    if not problem.model(pose[None]).any():
        return []
    contact = wrench_function(problem.model)
    q, given = pose[problem.columns] / KNEE_STEPS[problem.columns], (problem.loads[row], problem.rest[row])
    residual, slope = _balance(problem, contact)
    ways, stiffnesses, _ = np.linalg.svd(np.asarray(slope(q, *given)))
    fixed = ways[:, stiffnesses <= HELD * stiffnesses[0]]
    left = fixed @ (fixed.T @ np.asarray(residual(q, *given)).ravel())
    return [name for name, off in zip(problem.free, left, strict=True) if abs(off) > problem.tolerance_n[row]]


def _reasons(problem: StaticEquilibrium, pressed: Array, poses: Array, outcome: IpoptOutcome) -> np.ndarray:
    """Why rows are not in equilibrium in poses (n, 6), found from pressed ones; "" where they are."""
    held = held_beyond(problem.model, poses, problem.columns)
    misfit, tolerance = _misfit(problem, poses), problem.tolerance_n
    reason = np.full(len(misfit), "", dtype=object)
    for row in map(int, np.flatnonzero(~(np.abs(misfit).max(axis=1) <= tolerance))):  # nor where a load is no number
        worst = int(np.abs(misfit[row]).argmax())
        left = f"{problem.free[worst]} is unbalanced by {misfit[row, worst]:.3g} N (torques over {LEVER_MM:g} mm)"
        if held[row]:
            reason[row] = f"{held[row]}: at the nearest {left}"
        elif loose := _loose(problem, row, pressed[row]):
            reason[row] = (
                f"nothing holds {' and '.join(loose)} against the given loads, expected contact or a spring that does: "
                f"at the nearest {left}"
            )
        elif not outcome.solved:
            reason[row] = f"IPOPT stopped: {outcome.status}; {left}"
        else:
            where = " in the learned range" if np.isfinite(problem.lower).any() else ""
            reason[row] = f"not found{where}: at the nearest {left}"
    return reason
