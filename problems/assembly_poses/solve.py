"""The solution of an assembly's poses: bodies settled frame by frame, then all frames in one IPOPT problem."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.assembly import Settling
from casadi_contact.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.optimisation import IpoptOutcome, ipopt_options
from problems.assembly_poses.problem import AssemblyPoses
from problems.patella.follow import outwards
from problems.pose_estimation.solve import settled
from problems.pose_estimation.wanted import off_by

TOLERANCE_N = 1e-3  # left on a balanced body, torques over 25 mm


@dataclass(frozen=True)
class AssemblyResult:
    """Poses (n, bodies, 6), loads (n, L) of the assembly's ``load_names``, what is left on balanced bodies [N] (n,),
    errors (n, wanted) of what was measured, and what became of each frame."""

    poses: Array
    loads: Array
    residual_n: Array
    errors: Array
    converged: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float


def solve(problem: AssemblyPoses, start: Array | None = None, max_iterations: int = 300) -> AssemblyResult:
    """Settle the start, then solve with IPOPT.

    start: poses (n, bodies, 6), each frame's own; if left out, every frame begins at its solved neighbour. Never raises
    for frames that do not converge: each is reported with its errors.
    """
    began = time.perf_counter()
    poses = _settled(problem, start)
    scaling: dict[str, Any] = {"nlp_scaling_method": "none", "obj_scaling_factor": 1e-3}  # as of pose estimation
    solver = ca.nlpsol("poses", "ipopt", problem.nlp, ipopt_options(max_iterations=max_iterations, **scaling))
    answer = solver(x0=problem.variables(poses), lbx=problem.lower, ubx=problem.upper, lbg=0.0, ubg=0.0)
    outcome, count = IpoptOutcome.of(solver), len(problem.cycle)
    poses = np.asarray(problem.poses(answer["x"])).T.reshape(count, -1, 6)
    residual = np.abs(np.asarray(answer["g"])).reshape(count, -1).max(axis=1, initial=0.0)
    function = problem.assembly.function().map(count)
    loads = np.asarray(function(poses.reshape(-1, 6).T)).T
    converged, errors = residual <= TOLERANCE_N, np.empty((count, 0))
    if problem.measured:
        wanted = problem.measured.wanted
        body = problem.assembly.bodies.index(problem.measured_body)
        errors = wanted.errors(problem.measured.model(poses[:, body], wanted.load_names))
        converged &= wanted.carried(errors)
    reason = np.array([_why(problem, residual[k], errors[k], bool(converged[k])) for k in range(count)], dtype=object)
    seconds = time.perf_counter() - began
    return AssemblyResult(
        poses, loads, residual, errors, converged, reason, outcome.status, outcome.iterations, seconds
    )


def _settled(problem: AssemblyPoses, start: Array | None) -> Array:
    """Poses (n, bodies, 6) of the start: the measured body settled under its loads, then the others beside it."""
    assembly, cycle, given = problem.assembly, problem.cycle, problem.start_poses()
    poses = given.copy() if start is None else start.copy()
    if problem.measured:
        body = assembly.bodies.index(problem.measured_body)
        poses[:, body] = settled(problem.measured, poses[:, body])
    if not problem.free:
        return poses
    places = [(assembly.bodies.index(body), name) for body, names in problem.free.items() for name in names]
    rows = [6 * body + pose_index(name) for body, name in places]
    locked = [i for i in range(6 * len(assembly.bodies)) if i not in rows]
    off = (poses - assembly.start_poses()) * POSE_IN_MM
    first = int(np.abs(off.reshape(len(cycle), -1)[:, locked]).max(axis=1, initial=0.0).argmin())
    settle = Settling(assembly, problem.free)
    flat, solved = poses.reshape(len(cycle), -1), np.zeros(len(cycle), dtype=bool)
    for frame, neighbour in outwards(first, len(cycle)):
        beside = neighbour is not None and solved[neighbour]
        begins = [flat[frame]] if start is not None or not beside else []
        if beside:
            moved = flat[frame].copy()
            moved[rows] = flat[neighbour, rows]
            begins.append(moved)
        applied = dict(zip(assembly.bodies, problem.applied[:, frame].reshape(-1, 6), strict=True))
        for begin in begins:
            held = settle(begin.reshape(-1, 6), applied, list(problem.tensions[:, frame]), tolerance=TOLERANCE_N)
            if held.converged:
                flat[frame], solved[frame] = held.poses.ravel(), True
                break
    return flat.reshape(poses.shape)


def _why(problem: AssemblyPoses, residual: float, errors: Array, converged: bool) -> str:
    """Why a frame is not solved; "" if it is."""
    if converged:
        return ""
    missed = [f"{residual:.3g} N left on a body"] if residual > TOLERANCE_N else []
    if problem.measured:
        missed.append(off_by(problem.measured.wanted.values, errors))
    return f"not found: {', '.join(missed)}"
