"""The solution of pose estimation: all frames in one problem, then those left unsolved from solved neighbours."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array, pose_index
from casadi_contact.motion.load_cycle import LoadCycle
from casadi_contact.optimisation import IpoptOutcome, ipopt_options, pose_bounds, start_or_default
from casadi_contact.statics import settle
from problems.pose_estimation.march import march
from problems.pose_estimation.problem import FREE_COLUMNS, FREE_STEPS, LOADS, PoseEstimation, cop, wanted_of

FORCE_TOLERANCE_N = 1.0
COP_TOLERANCE_MM = 0.1
_FRAME_ITERATIONS = 100  # of a frame alone
# IPOPT scales by the gradient at the start: begun at the solution, it then asks for the impossible. With this scale
# and its tolerance gradients end below 1e-5 N², residuals below about 1e-7 N.
_SCALING: dict[str, Any] = {"nlp_scaling_method": "none", "obj_scaling_factor": 1e-3}


@dataclass(frozen=True)
class PoseResult:
    """Poses (n, 6), surrogate loads there (n, 4) as in `LOADS`, and what became of each frame.

    on_model (n,): True for frames that are solved on the contact model itself, with its loads (`complete`);
    on_rim (n,): for those of them whose contact reaches the edge of the insert.
    """

    poses: Array
    loads: Array
    force_error_n: Array
    cop_error_mm: Array
    converged: np.ndarray
    on_model: np.ndarray
    on_rim: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float


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
    their solved neighbours (without smoothness, which couples frames; `march`). Never raises for frames that do not
    converge: each is reported with its errors and the reason.
    """
    cycle, contact = problem.cycle, problem.contact
    began = time.perf_counter()
    poses = start_or_default(start, problem.start_poses())
    # Settling needs the learned range: outside it s may have another root, from which IPOPT does not come back.
    low, high = pose_bounds(problem.surrogate)
    poses[:, FREE_COLUMNS] = np.clip(poses[:, FREE_COLUMNS], low[FREE_COLUMNS], high[FREE_COLUMNS])
    poses[:, pose_index("ry")], poses[:, pose_index("rz")] = cycle.ry, cycle.rz
    forces = {"Fy_med": cycle.fy_med, "Fy_lat": cycle.fy_lat}
    poses, _ = settle(problem.surrogate, poses, ("ty", "rx"), forces, tolerance=0.1, max_iterations=30)
    options = ipopt_options(max_iterations=max_iterations, print_level=print_level, **_SCALING)
    solver = ca.nlpsol("pose_estimation", "ipopt", problem.nlp, options)
    answer = solver(x0=contact.variables(poses), lbx=contact.lower, ubx=contact.upper)
    outcome = IpoptOutcome.of(solver)
    x = np.asarray(answer["x"]).reshape(-1, 4)
    poses[:, FREE_COLUMNS] = x * FREE_STEPS
    result = _result(problem, poses, outcome, outcome.iterations, time.perf_counter() - began)
    if not alone or problem.smoothness > 0.0 or result.converged.all() or not result.converged.any():
        return result
    one, wanted = frame_solver(problem, print_level), wanted_of(cycle).T
    more = march(one, x, wanted, result.converged, contact.lower[:4], contact.upper[:4])
    poses[:, FREE_COLUMNS] = x * FREE_STEPS
    return _result(problem, poses, outcome, outcome.iterations + more, time.perf_counter() - began)


def frame_solver(problem: PoseEstimation, print_level: int = 0) -> ca.Function:
    """nlpsol of `PoseEstimation.one_frame`."""
    options = ipopt_options(max_iterations=_FRAME_ITERATIONS, print_level=print_level, **_SCALING)
    return ca.nlpsol("one_frame", "ipopt", problem.one_frame(), options)


def errors_of(cycle: LoadCycle, loads: Array) -> tuple[Array, Array]:
    """Errors of the vertical forces (n, 2) [N] and of the centres of pressure (n, 2) [mm] of loads (n, 4)."""
    force_error = loads[:, :2] - np.column_stack([cycle.fy_med, cycle.fy_lat])
    return force_error, cop(loads) - np.column_stack([cycle.cop_ap_mm, cycle.cop_ml_mm])


def carried(force_error: Array, cop_error: Array) -> np.ndarray:
    """True (n,) where the wanted loads are met; False without load, which has no centre of pressure."""
    force_ok = np.abs(force_error).max(axis=1) <= FORCE_TOLERANCE_N
    return np.asarray(force_ok & (np.abs(cop_error).max(axis=1) <= COP_TOLERANCE_MM))


def _result(
    problem: PoseEstimation, poses: Array, outcome: IpoptOutcome, iterations: int, seconds: float
) -> PoseResult:
    """Errors of each frame, and whether it carries the wanted loads."""
    cycle = problem.cycle
    loads = problem.surrogate(poses, LOADS)
    force_error, cop_error = errors_of(cycle, loads)
    # Without smoothness frames stand alone: one that carries its loads is solved, whatever IPOPT met in another.
    converged = carried(force_error, cop_error) & (outcome.solved or problem.smoothness == 0.0)
    reason = np.full(len(cycle), "", dtype=object)
    ended = "not found in the learned range" if outcome.solved else f"IPOPT stopped ({outcome.status})"
    for k in np.flatnonzero(~converged):
        reason[k] = (
            f"{ended}: forces off by {np.abs(force_error[k]).max():.3g} N, "
            f"centre of pressure by {np.abs(cop_error[k]).max():.3g} mm at the nearest"
        )
    none = np.zeros(len(cycle), dtype=bool)
    return PoseResult(
        poses, loads, force_error, cop_error, converged, none, none, reason, outcome.status, iterations, seconds
    )
