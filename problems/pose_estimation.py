"""Pose estimation: the poses of a cycle that carry measured medial and lateral forces and centres of pressure (§3.3).

ry and rz are locked to the measured curves; tx, ty, tz and rx of every frame are free. All frames stand in one IPOPT
problem with exact Hessian:

    min ½ Σ |r_k(q_k)|² + ½ smoothness·Σ |q_{k+1} - q_k|²    with q_k in the learned range

    r = ( 2·√(N0·N*_med)·(s_med - s*_med),  2·√(N0·N*_lat)·(s_lat - s*_lat),
          (Tz - cop_ap*·Fy)/L,  (Tx + cop_ml*·Fy)/L )    [N]

with starred values wanted, s = √(N/N0) the signed root load, Fy the surrogate's own total, and L = 10 mm. Forces are
compared as root loads because those are nearly linear in the pose and keep their slope out of contact (near the
solution the residual is the force error); the centre of pressure is written without dividing by the load. Variables
are scaled by the moves that change the residuals alike, so that IPOPT's regularisation bears on all of them alike.
Frames that this leaves unsolved are solved alone, from their solved neighbours (`pose_estimation_march`).

Run ``python -m problems.pose_estimation --help``.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer

from casadi_contact.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.files import writable_folder
from casadi_contact.motion.load_cycle import LoadCycle, read_cycle
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.statics import settle
from casadi_contact.structures import Surrogate, load_surrogate
from problems.command import run_command
from problems.pose_estimation_march import march

FREE = ("tx", "ty", "tz", "rx")
LOADS = ("Fy_med", "Fy_lat", "Tx", "Tz")
FORCE_TOLERANCE_N = 1.0
COP_TOLERANCE_MM = 0.1
_LEVER_MM = 10.0
_SCALES = 1.0 / np.array([0.5, 0.01, 0.3, 0.01 / 25.0])  # 1 / moves [mm, rad] of tx, ty, tz, rx, like in effect
_IN_MM = np.array([1.0, 1.0, 1.0, 25.0])  # turns rad into comparable mm
_OBJECTIVE_SCALE = 1e-3  # with IPOPT's tolerance: gradients below 1e-5 N², residuals below about 1e-7 N
_FRAME_ITERATIONS = 100  # of a frame alone
_FREE_COLUMNS = [POSE_NAMES.index(name) for name in FREE]


@dataclass(frozen=True)
class PoseEstimation:
    """A problem that can be looked at unsolved: CasADi's nlp, bounds on its variables, and what it came from."""

    surrogate: Surrogate
    cycle: LoadCycle
    smoothness: float
    compiled: bool
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    residuals: ca.Function

    @cached_property
    def frame_nlp(self) -> dict[str, Any]:
        """The problem of one frame alone, with what is wanted of it (`_wanted`) as parameters (6)."""
        q, wanted = ca.MX.sym("q", 4), ca.MX.sym("wanted", 6)
        residuals = _residuals(self.surrogate, q, wanted, compiled=self.compiled)
        return {"x": q, "p": wanted, "f": 0.5 * ca.sumsqr(residuals)}

    def start_poses(self, offsets: Array | None = None) -> Array:
        """Start poses (n, 6): the middle of the learned range at ry and rz of the cycle, plus offsets (n, 4) of the
        free parameters; tx, tz and rx are brought into the learned range."""
        low, high = _pose_bounds(self.surrogate)
        poses = np.zeros((len(self.cycle), 6))
        middle = np.where(np.isfinite(low + high), 0.5 * (low + high), 0.0)
        poses[:, _FREE_COLUMNS] = middle + (0.0 if offsets is None else offsets)
        for column, name in zip(_FREE_COLUMNS, FREE, strict=True):
            if name != "ty":
                poses[:, column] = np.clip(poses[:, column], low[FREE.index(name)], high[FREE.index(name)])
        poses[:, POSE_NAMES.index("ry")], poses[:, POSE_NAMES.index("rz")] = self.cycle.ry, self.cycle.rz
        return poses


@dataclass(frozen=True)
class PoseResult:
    """Poses (n, 6), surrogate loads there (n, 4) as in `LOADS`, and what became of each frame."""

    poses: Array
    loads: Array
    force_error_n: Array
    cop_error_mm: Array
    converged: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float


def cop(loads: Array) -> Array:
    """Centre of pressure (n, 2): (Tz/Fy, -Tx/Fy) [mm], NaN without load, for loads (n, 4) as in `LOADS`."""
    fy = loads[:, 0] + loads[:, 1]
    fy = np.where(fy < 0.0, fy, np.nan)
    return np.column_stack([loads[:, LOADS.index("Tz")] / fy, -loads[:, LOADS.index("Tx")] / fy])


def _pose_bounds(surrogate: Surrogate) -> tuple[Array, Array]:
    """Range of the free parameters that the surrogate was trained on, unbounded where it does not say."""
    ranges = surrogate.record.get("pose_range", {})
    pairs = [ranges.get(name, (-np.inf, np.inf)) for name in FREE]
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])


def _wanted(cycle: LoadCycle) -> Array:
    """Forces [N], centre of pressure [mm], ry and rz [rad] of all frames (6, n)."""
    return np.stack([cycle.fy_med, cycle.fy_lat, cycle.cop_ap_mm, cycle.cop_ml_mm, cycle.ry, cycle.rz])


def _residuals(surrogate: Surrogate, q: ca.MX, wanted: ca.MX | ca.DM, *, compiled: bool) -> ca.MX:
    """Residuals (4, n) [N] of frames with the scaled free parameters q (4, n) and what is wanted of them (6, n)."""
    n0, least, count = surrogate.scene.reference_load, surrogate.scene.boundary_load, q.shape[1]
    poses = ca.vertcat(ca.mtimes(ca.diag(ca.DM(1.0 / _SCALES)), q), wanted[4:, :])
    loads, roots = surrogate.load_and_root_function(LOADS, compiled=compiled, batch=count)(poses)
    wanted_roots = ca.sqrt(-wanted[:2, :] / n0)
    weights = 2.0 * n0 * ca.fmax(wanted_roots, np.sqrt(least / n0))
    fy_med, fy_lat, tx, tz = ca.vertsplit(loads)
    fy = fy_med + fy_lat
    return ca.vertcat(
        weights * (roots - wanted_roots),
        (tz - wanted[2, :] * fy) / _LEVER_MM,
        (tx + wanted[3, :] * fy) / _LEVER_MM,
    )


def build(surrogate: Surrogate, cycle: LoadCycle, smoothness: float = 0.0, *, compiled: bool = False) -> PoseEstimation:
    """Pose the problem for all frames of a cycle; smoothness [N²/mm²] weighs the change from frame to frame.

    compiled: the surrogate as a C kernel, which solves several times faster once it is compiled (`Surrogate.function`).
    Raises ValueError for a negative smoothness or a surrogate without the needed loads.
    """
    if not smoothness >= 0.0:
        raise ValueError(f"smoothness is {smoothness}, expected a number >= 0")
    count = len(cycle)
    q = ca.MX.sym("q", 4, count)
    residuals = _residuals(surrogate, q, ca.DM(_wanted(cycle)), compiled=compiled)
    objective = 0.5 * ca.sumsqr(residuals)
    if smoothness > 0.0 and count > 1:
        steps_mm = (q[:, 1:] - q[:, :-1]) * ca.repmat(ca.DM(_IN_MM / _SCALES), 1, count - 1)
        objective += 0.5 * smoothness * ca.sumsqr(steps_mm)
    nlp = {"x": ca.vec(q), "f": objective}
    low, high = _pose_bounds(surrogate)
    lower, upper = np.tile(low * _SCALES, count), np.tile(high * _SCALES, count)
    all_residuals = ca.Function("all_residuals", [q], [residuals])
    return PoseEstimation(surrogate, cycle, smoothness, compiled, nlp, lower, upper, all_residuals)


def solve(
    problem: PoseEstimation,
    start: Array | None = None,
    max_iterations: int = 300,
    print_level: int = 0,
    *,
    alone: bool = True,
) -> PoseResult:
    """Bring the start into the learned range, settle its ty and rx under the wanted forces, then solve with IPOPT.

    start: poses (n, 6), `PoseEstimation.start_poses` if left out. alone: frames left unsolved are solved alone from
    their solved neighbours (without smoothness, which couples frames; `pose_estimation_march`). Never raises for
    frames that do not converge: each is reported with its errors and the reason.
    """
    cycle, surrogate = problem.cycle, problem.surrogate
    began = time.perf_counter()
    poses = problem.start_poses() if start is None else as_poses(start).copy()
    if len(poses) != len(cycle):
        raise ValueError(f"start has {len(poses)} poses, expected one for each of {len(cycle)} frames")
    # Settling needs the learned range: outside it s may have another root, from which IPOPT does not come back.
    low, high = _pose_bounds(surrogate)
    poses[:, _FREE_COLUMNS] = np.clip(poses[:, _FREE_COLUMNS], low, high)
    poses[:, POSE_NAMES.index("ry")], poses[:, POSE_NAMES.index("rz")] = cycle.ry, cycle.rz
    forces = {"Fy_med": cycle.fy_med, "Fy_lat": cycle.fy_lat}
    poses, _ = settle(surrogate, poses, ("ty", "rx"), forces, tolerance=0.1, max_iterations=30)
    options: dict[str, Any] = {
        "ipopt": {
            "print_level": print_level,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": 1e-8,
            "hessian_approximation": "exact",
            # IPOPT scales by the gradient at the start: begun at the solution, it then asks for the impossible.
            "nlp_scaling_method": "none",
            "obj_scaling_factor": _OBJECTIVE_SCALE,
        },
        "print_time": False,
    }
    solver = ca.nlpsol("pose_estimation", "ipopt", problem.nlp, options)
    x0 = np.clip((poses[:, _FREE_COLUMNS] * _SCALES).ravel(), problem.lower, problem.upper)
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper)
    status, iterations = str(solver.stats()["return_status"]), int(solver.stats()["iter_count"])
    x = np.asarray(answer["x"]).reshape(-1, 4)
    poses[:, _FREE_COLUMNS] = x / _SCALES
    result = _judged(problem, poses, status, iterations, time.perf_counter() - began)
    if not alone or problem.smoothness > 0.0 or result.converged.all() or not result.converged.any():
        return result
    options["ipopt"]["max_iter"] = _FRAME_ITERATIONS
    one = ca.nlpsol("one_frame", "ipopt", problem.frame_nlp, options)
    iterations += march(one, x, _wanted(cycle).T, result.converged, problem.lower[:4], problem.upper[:4])
    poses[:, _FREE_COLUMNS] = x / _SCALES
    return _judged(problem, poses, status, iterations, time.perf_counter() - began)


def _judged(problem: PoseEstimation, poses: Array, status: str, iterations: int, seconds: float) -> PoseResult:
    """Errors of each frame, and whether it carries the wanted loads."""
    cycle = problem.cycle
    loads = problem.surrogate(poses, LOADS)
    force_error = loads[:, :2] - np.column_stack([cycle.fy_med, cycle.fy_lat])
    cop_error = cop(loads) - np.column_stack([cycle.cop_ap_mm, cycle.cop_ml_mm])
    force_ok = np.abs(force_error).max(axis=1) <= FORCE_TOLERANCE_N
    cop_ok = np.abs(cop_error).max(axis=1) <= COP_TOLERANCE_MM  # False for NaN: no load, no centre of pressure
    solved = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    # Without smoothness frames stand alone: one that carries its loads is solved, whatever IPOPT met in another.
    converged = force_ok & cop_ok & (solved or problem.smoothness == 0.0)
    reason = np.full(len(cycle), "", dtype=object)
    for k in np.flatnonzero(~converged):
        reason[k] = (
            ("no pose in the learned range carries these loads: " if solved else f"IPOPT stopped ({status}): ")
            + f"forces off by {np.abs(force_error[k]).max():.3g} N, "
            + f"centre of pressure by {np.abs(cop_error[k]).max():.3g} mm at the nearest"
        )
    return PoseResult(poses, loads, force_error, cop_error, converged, reason, status, iterations, seconds)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    cycle: Annotated[Path | None, typer.Option(help="measured cycle (CSV); the reference cycle if left out")] = None,
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    out: Annotated[Path, typer.Option(help="folder for pose_estimation.csv, .png and summary.json")] = Path("results"),
    smoothness: Annotated[float, typer.Option(help="weight of frame-to-frame change [N²/mm²]")] = 0.0,
    starts: Annotated[int, typer.Option(min=0, help="also solve from this many random starts")] = 0,
    start: Annotated[
        Path | None,
        typer.Option(help="begin at these poses (CSV, .sto), spread over the cycle, with its ry and rz"),
    ] = None,
    warm: Annotated[str | None, typer.Option(help="begin at the solution on this other surrogate")] = None,
    compiled: Annotated[bool, typer.Option("--compiled", help="use a compiled C kernel of the surrogate")] = False,
) -> None:
    """Find the poses of a cycle that match its measured forces and centres of pressure; check them on the EF."""
    from problems.pose_estimation_report import report  # draws with matplotlib: not needed to solve
    from problems.pose_estimation_starts import random_starts, start_from_file

    if start is not None and warm is not None:
        raise ValueError("got both --start and --warm, expected one of them")
    writable_folder(out)  # before minutes of random starts
    measured = reference_cycle() if cycle is None else read_cycle(cycle)
    problem = build(load_surrogate(surrogate), measured, smoothness, compiled=compiled)
    poses = None if start is None else start_from_file(start, len(measured))
    if warm is not None:
        poses = solve(build(load_surrogate(warm), measured)).poses
    result = solve(problem, poses)
    report(problem, result, out, random_starts(surrogate, measured, result.poses, starts) if starts else None)
    if not result.converged.all():
        frames = ", ".join(map(str, np.flatnonzero(~result.converged)))
        print(f"pose_estimation: no converged pose at frames {frames}; reasons in {out}", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; unsolved frames are exit status 2."""
    run_command(app, "pose_estimation")


if __name__ == "__main__":
    main()
