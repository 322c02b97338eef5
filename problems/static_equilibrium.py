"""Settling: the pose at which contact and soft tissue carry six given loads.

The loads (Fx, Fy, Fz, Tx, Ty, Tz) press the moving body on the fixed one and are given as they reach the fixed body,
about its origin or the moving one. For the free pose parameters i the generalised forces must balance,

    r_i(q) = Q_i(q; loads) - Q_i(q; W(q)) - k_i·(q_i - rest_i) = 0    [N, N·mm]

(Q as in `problems.joint_mechanics`, W the surrogate's wrench, k the stated soft-tissue stiffness), solved as

    min ½ Σ |r_i / L_i|²    with q in the learned range, L = 1 for forces and 25 mm for torques

by IPOPT with exact Hessian, all given loads in one problem. Without springs (k = 0) and with all six parameters free
this asks for W(q) = loads. Two condyles without friction cannot carry any six loads: their forces pass through the
axis of the condyle arcs, so nothing holds the flexion rz, and along tz and about ry the dishes hold only as much as
the joint is pressed together. So rz is locked by default, and where it is free a spring holds it; `SOFT_TISSUE` are
stated springs of about the size of a knee held by its tissue and muscles, used where asked for. Loads that no pose
carries end at the nearest pose in the sense of the sum above and are reported with the reason.

A start may be anywhere: it is brought into the learned range, and ty and rx are settled under the shares of Fy and
Tx that condyles carry at their offset, in root loads, which keep their slope out of contact.

Run ``python -m problems.static_equilibrium --help``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer
from numpy.typing import ArrayLike
from scipy.optimize import root

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import POSE_NAMES, WRENCH_NAMES, Array, as_poses, pose_index
from casadi_contact.files import writable_folder
from casadi_contact.structures import Surrogate, load_surrogate
from problems.command import run_command
from problems.equilibrium_start import pressed_together
from problems.foundation_callback import total_selection
from problems.joint_mechanics import IN_MM, LEVER_MM, STEPS, generalised_forces, wrench_function
from problems.learned_range import middle_pose, pose_bounds

FREE = ("tx", "ty", "tz", "rx", "ry")
SOFT_TISSUE = {"tx": 5.0, "ty": 0.0, "tz": 5.0, "rx": 0.0, "ry": 5.0e3, "rz": 1.0e5}  # [N/mm, N·mm/rad]
TOLERANCE_N = 0.1  # of every residual, torques over 25 mm


@dataclass(frozen=True)
class StaticEquilibrium:
    """A problem that can be looked at unsolved: CasADi's nlp, bounds on its variables, and what it came from.

    loads (n, 6) as in `WRENCH_NAMES`; rest (n, 6) poses: values of the locked parameters and ends of the springs;
    stiffness (6,); residuals: function of the stacked scaled free parameters (f, n) -> r/L (f, n) [N].
    """

    surrogate: Surrogate
    loads: Array
    about: str
    free: tuple[str, ...]
    rest: Array
    stiffness: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    residuals: ca.Function

    @property
    def columns(self) -> list[int]:
        """Columns of the free parameters in a pose array."""
        return [pose_index(name) for name in self.free]


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


def residual_function(contact: ca.Function, free: Sequence[str], about: str, stiffness: Array) -> ca.Function:
    """(scaled free q (f), loads (6), rest (6)) -> r/L of the free parameters (f) [N]."""
    columns = [pose_index(name) for name in free]
    q, loads, rest = ca.MX.sym("q", len(columns)), ca.MX.sym("loads", 6), ca.MX.sym("rest", 6)
    entries = [q[columns.index(i)] * STEPS[i] if i in columns else rest[i] for i in range(6)]
    pose = ca.vertcat(*entries)
    given = generalised_forces(pose, loads, about=about)
    carried = generalised_forces(pose, contact(pose))
    r = (given - carried - ca.DM(stiffness) * (pose - rest)) / ca.DM(IN_MM)
    return ca.Function("residuals", [q, loads, rest], [r[columns]])


def build(
    surrogate: Surrogate,
    loads: ArrayLike,
    *,
    free: Sequence[str] = FREE,
    rest: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    about: str = "fixed",
) -> StaticEquilibrium:
    """Pose the problem for loads (n, 6) about the ``fixed`` or ``moving`` origin.

    rest: poses (n, 6) or (6,) that hold the locked parameters and where springs are slack (the middle of the learned
    range if left out); stiffness (6,) [N/mm, N·mm/rad], none if left out.
    Raises ValueError for wrong shapes, unknown names, negative stiffness, or six free parameters without a spring
    on rz.
    """
    wanted = np.atleast_2d(np.asarray(loads, dtype=float))
    if wanted.ndim != 2 or wanted.shape[1] != 6 or not np.isfinite(wanted).all():
        raise ValueError(f"loads has shape {wanted.shape}, expected finite (n, 6): {' '.join(WRENCH_NAMES)}")
    if not free or len(set(free)) != len(free):
        raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
    columns = [pose_index(name) for name in free]
    springs = np.zeros(6) if stiffness is None else np.asarray(stiffness, dtype=float)
    if springs.shape != (6,) or not (np.isfinite(springs) & (springs >= 0.0)).all():
        raise ValueError(f"stiffness is {springs.tolist()}, expected 6 numbers >= 0: {' '.join(POSE_NAMES)}")
    if "rz" in free and springs[pose_index("rz")] == 0.0:
        raise ValueError("rz is free but contact does not hold flexion: lock rz, or give it a spring")
    count = len(wanted)
    at = np.asarray(middle_pose(surrogate) if rest is None else rest, dtype=float)
    poses = as_poses(np.broadcast_to(at, (count, 6)) if at.shape == (6,) else at)
    if len(poses) != count:
        raise ValueError(f"rest has {len(poses)} poses, expected one, or one for each of {count} loads")
    residual = residual_function(wrench_function(surrogate), free, about, springs)
    q = ca.MX.sym("q", len(columns), count)
    residuals = residual.map(count)(q, ca.DM(wanted.T), ca.DM(poses.T))
    nlp = {"x": ca.vec(q), "f": 0.5 * ca.sumsqr(residuals)}
    low, high = (np.tile((bound / STEPS)[columns], count) for bound in pose_bounds(surrogate))
    return StaticEquilibrium(
        surrogate=surrogate,
        loads=wanted,
        about=about,
        free=tuple(free),
        rest=poses,
        stiffness=springs,
        nlp=nlp,
        lower=low,
        upper=high,
        residuals=ca.Function("all_residuals", [q], [residuals]),
    )


def solve(
    problem: StaticEquilibrium, start: ArrayLike | None = None, max_iterations: int = 300, print_level: int = 0
) -> EquilibriumResult:
    """Solve with IPOPT from a start (n, 6), the rest poses if left out.

    Never raises for loads that no pose carries: each row is reported with its misfit and the reason.
    """
    began = time.perf_counter()
    poses = problem.rest.copy() if start is None else as_poses(start).copy()
    if len(poses) != len(problem.loads):
        raise ValueError(f"start has {len(poses)} poses, expected one for each of {len(problem.loads)} loads")
    poses = pressed_together(problem.surrogate, poses, problem.rest, problem.loads, problem.free)
    columns = problem.columns
    options: dict[str, Any] = {
        "ipopt": {
            "print_level": print_level,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": 1e-8,
            "hessian_approximation": "exact",
        },
        "print_time": False,
    }
    solver = ca.nlpsol("static_equilibrium", "ipopt", problem.nlp, options)
    x0 = np.clip((poses / STEPS)[:, columns].ravel(), problem.lower, problem.upper)
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper)
    stats = solver.stats()
    q = np.asarray(answer["x"]).reshape(len(columns), -1, order="F")
    poses[:, columns] = q.T * STEPS[columns]
    misfit = np.asarray(problem.residuals(q)).T
    converged = np.abs(misfit).max(axis=1) <= TOLERANCE_N
    status = str(stats["return_status"])
    return EquilibriumResult(
        poses=poses,
        wrenches=problem.surrogate(poses) @ total_selection(problem.surrogate.load_names).T,
        misfit_n=misfit,
        converged=converged,
        reason=_reasons(problem, misfit, converged, status),
        ipopt_status=status,
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - began,
    )


def on_model(problem: StaticEquilibrium, result: EquilibriumResult, model: ContactModel) -> Array:
    """The poses (n, 6) at which another contact model carries the same loads, found from the surrogate's by SciPy's
    Powell hybrid method with the model's Jacobian; NaN where there was none to begin from or none is found."""
    columns = problem.columns
    contact = wrench_function(model)
    residual = residual_function(contact, problem.free, problem.about, problem.stiffness)
    q, loads, rest = (ca.MX.sym(name, size) for name, size in (("q", len(columns)), ("loads", 6), ("rest", 6)))
    slope = ca.Function("slope", [q, loads, rest], [ca.jacobian(residual(q, loads, rest), q)])
    found = np.full_like(result.poses, np.nan)
    for row in np.flatnonzero(result.converged):
        given = (problem.loads[row], problem.rest[row])
        answer = root(
            lambda q, given=given: np.asarray(residual(q, *given)).ravel(),
            result.poses[row, columns] / STEPS[columns],
            jac=lambda q, given=given: np.asarray(slope(q, *given)),
        )
        if np.abs(answer.fun).max() <= TOLERANCE_N:
            found[row] = problem.rest[row]
            found[row, columns] = answer.x * STEPS[columns]
    return found


def _reasons(problem: StaticEquilibrium, misfit: Array, converged: np.ndarray, status: str) -> np.ndarray:
    solved = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    reason = np.full(len(misfit), "", dtype=object)
    for row in np.flatnonzero(~converged):
        worst = int(np.abs(misfit[row]).argmax())
        left = f"{problem.free[worst]} is unbalanced by {misfit[row, worst]:.3g} N (torques over {LEVER_MM:g} mm)"
        if problem.loads[row, WRENCH_NAMES.index("Fy")] >= 0.0:
            reason[row] = f"Fy does not press the bodies together (compression is negative); {left}"
        elif not solved:
            reason[row] = f"IPOPT stopped: {status}; {left}"
        else:
            reason[row] = f"no pose in the learned range carries these loads: at the nearest {left}"
    return reason


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    fx: Annotated[float, typer.Option(help="posterior force on the insert [N]")] = -100.0,
    fy: Annotated[float, typer.Option(help="vertical force on the insert, compression negative [N]")] = -1500.0,
    fz: Annotated[float, typer.Option(help="medial force on the insert [N]")] = 0.0,
    tx: Annotated[float, typer.Option(help="torque about x, at the moving origin [N·mm]")] = 7500.0,
    ty: Annotated[float, typer.Option(help="torque about y [N·mm]")] = -2000.0,
    tz: Annotated[float, typer.Option(help="torque about z [N·mm]; balanced by the lock while rz is locked")] = 0.0,
    flexions: Annotated[str, typer.Option(help="flexion angles [deg], separated by commas")] = "0,5,15,30,45,60,75",
    soft: Annotated[bool, typer.Option(help="free rz too, with soft-tissue springs slack at the flexion")] = False,
    starts: Annotated[int, typer.Option(min=0, help="also solve from this many random starts")] = 20,
    warm: Annotated[str | None, typer.Option(help="begin at the solution on this other surrogate")] = None,
    out: Annotated[Path, typer.Option(help="folder for static_equilibrium.csv, .png, .json")] = Path("results"),
) -> None:
    """Find the poses that carry six loads over flexion; check them on the EF and from random starts."""
    from problems.static_equilibrium_report import random_starts, report  # draws: not needed to solve

    writable_folder(out)
    model = load_surrogate(surrogate)
    try:
        angles = np.radians([float(text) for text in flexions.split(",")])
    except ValueError:
        raise ValueError(f"flexions is {flexions!r}, expected numbers separated by commas") from None
    rest = np.tile(middle_pose(model), (len(angles), 1))
    rest[:, [pose_index(name) for name in ("tx", "tz", "ry")]] = 0.0
    rest[:, pose_index("rz")] = -angles
    loads = np.tile([fx, fy, fz, tx, ty, tz], (len(angles), 1))
    free = POSE_NAMES if soft else FREE
    springs = np.array([SOFT_TISSUE[name] for name in POSE_NAMES]) if soft else None

    def on(chosen: Surrogate) -> StaticEquilibrium:
        return build(chosen, loads, free=free, rest=rest, stiffness=springs, about="moving")

    problem = on(model)
    result = solve(problem, None if warm is None else solve(on(load_surrogate(warm))).poses)
    report(problem, result, out, random_starts(problem, result, starts) if starts else None)
    if not result.converged.all():
        rows = ", ".join(map(str, np.flatnonzero(~result.converged)))
        print(f"static_equilibrium: no equilibrium for rows {rows}; reasons in {out}", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; no equilibrium is exit status 2."""
    run_command(app, "static_equilibrium")


if __name__ == "__main__":
    main()
