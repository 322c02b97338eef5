"""Rows that one start leaves unsolved, begun again elsewhere: where a body is convex, as a natural tibia's lateral side
is, the misfit has minima off balance beside the equilibrium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array
from casadi_contact.optimisation.starts import press_together
from problems.common.learned_range import held_beyond
from problems.static_equilibrium.balance import Balance
from problems.static_equilibrium.problem import StaticEquilibrium
from problems.static_equilibrium.pulls import pulls
from problems.static_equilibrium.solve import EquilibriumResult, solve

_ASIDE = np.array([6.0, 0.0, 3.0, 0.1, 0.3, 0.0])  # [mm, rad]; what presses is settled at every start


def search(problem: StaticEquilibrium, result: EquilibriumResult, count: int) -> EquilibriumResult:
    """The result with its unsolved rows begun again, each at up to `count` starts: random ones about the pose of the
    row in equilibrium whose rest pose is nearest, or about its own rest pose while there is none.

    Rows stay as they are where no start helps: loads that contact carries in no pose, what is held outside of the
    learned range, and what nothing holds.
    """
    left = np.flatnonzero(_may_help(problem, result))
    poses, wrenches, misfit_n = result.poses.copy(), result.wrenches.copy(), result.misfit_n.copy()
    converged, reason = result.converged.copy(), result.reason.copy()
    status, iterations, seconds = result.ipopt_status, result.iterations, result.seconds
    rng = np.random.default_rng(11)
    for _ in range(count):
        if not len(left):
            break
        moves = rng.uniform(-1.0, 1.0, (len(left), len(_ASIDE))) * _ASIDE
        again = solve(problem.of_rows(left), _beside(problem, poses, converged)[left] + moves)
        status, iterations, seconds = again.ipopt_status, iterations + again.iterations, seconds + again.seconds
        found, rows = again.converged, left[again.converged]
        poses[rows], wrenches[rows], misfit_n[rows] = again.poses[found], again.wrenches[found], again.misfit_n[found]
        converged[rows], reason[rows] = True, ""
        left = left[~found]
    if count:
        reason[left] = [f"{reason[row]}; not from {count} other starts either" for row in left]
    return replace(
        result,
        poses=poses,
        wrenches=wrenches,
        misfit_n=misfit_n,
        converged=converged,
        reason=reason,
        ipopt_status=status,
        iterations=iterations,
        seconds=seconds,
    )


def _may_help(problem: StaticEquilibrium, result: EquilibriumResult) -> np.ndarray:
    """True (n,) for unsolved rows that another start might solve."""
    held = held_beyond(problem.model, result.poses, problem.columns)
    open_rows = ~result.converged & (pulls(problem) == "") & (held == "")
    rows = np.flatnonzero(open_rows)
    if len(rows):
        balance = Balance.of(problem, problem.model)
        pressed = press_together(problem.model, problem.rest, problem.rest, problem.loads, problem.free)
        open_rows[rows] = [not balance.loose(row, pressed[row]) for row in rows.tolist()]
    return np.asarray(open_rows)


def _beside(problem: StaticEquilibrium, poses: Array, converged: np.ndarray) -> Array:
    """Where starts of all rows (n, 6) lie: at the pose of the nearest row in equilibrium, at rest without any."""
    rows = np.flatnonzero(converged)
    if not len(rows):
        return problem.rest
    apart = np.linalg.norm((problem.rest[:, None] - problem.rest[rows]) * POSE_IN_MM, axis=2)
    return np.asarray(poses[rows[apart.argmin(axis=1)]])
