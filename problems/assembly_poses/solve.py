"""The solution of an assembly's poses: bodies settled frame by frame, then all frames in one IPOPT problem."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.assembly.settle import Settling
from casadi_contact.optimisation.ipopt import FrameOutcome, IpoptOutcome, least_squares_options
from problems.assembly_poses.cycle import two_or_more
from problems.assembly_poses.problem import AssemblyPoses, build
from problems.patella.follow import outwards

TOLERANCE_N = 1e-3  # left on a balanced body, torques over 25 mm
# IPOPT's, a hundredth of that. Asked for more, Newton's steps go astray where a pose is hardly determined, such as that
# of a patella off its groove, and frames share the length of a step.
_IPOPT_TOLERANCE = 1e-5
_ROUNDS = 3  # of IPOPT, at most: frames left unsolved begin once more beside solved ones, without these


@dataclass(frozen=True)
class AssemblyResult:
    """Poses (n, bodies, 6), loads (n, L) of the assembly's ``load_names``, what is left on balanced bodies [N] (n,),
    errors (n, wanted) of what was measured, and what became of each frame.

    on_model (n,): True for frames that are solved on the contact models themselves, with their loads (`corrected`).
    """

    poses: Array
    loads: Array
    residual_n: Array
    errors: Array
    converged: np.ndarray
    on_model: np.ndarray
    reason: np.ndarray
    ipopt_status: str
    iterations: int
    seconds: float


@dataclass(frozen=True)
class _Found:
    """Poses, residuals and errors of frames as in `AssemblyResult`. Frames stand alone."""

    poses: Array
    residual_n: Array
    errors: Array

    @classmethod
    def at(cls, problem: AssemblyPoses, poses: Array) -> _Found:
        """What bodies and measured contact say of poses (n, bodies, 6)."""
        count = len(problem.cycle)
        left = ca.Function("left", [problem.nlp["x"]], [problem.nlp["g"]])(problem.variables(poses))
        residual_n = np.abs(np.asarray(left)).reshape(count, -1).max(axis=1, initial=0.0)
        if not problem.measured:
            return cls(poses, residual_n, np.empty((count, 0)))
        wanted, body = problem.measured.targets, problem.assembly.bodies.index(problem.measured_body)
        return cls(poses, residual_n, wanted.errors(problem.measured.model(poses[:, body], wanted.load_names)))

    @property
    def off(self) -> Array:
        """How far frames (n,) are off; infinite without contact."""
        return np.nan_to_num(np.hypot(self.residual_n, np.linalg.norm(self.errors, axis=1)), nan=np.inf)

    def converged(self, problem: AssemblyPoses) -> np.ndarray:
        """True (n,) where bodies balance and carry what was measured."""
        balanced = self.residual_n <= TOLERANCE_N
        return balanced & problem.measured.targets.met(self.errors) if problem.measured else balanced

    def or_better(self, other: _Found, rows: np.ndarray) -> _Found:
        """These, and of the frames `rows` those of the other that are less off."""
        better = other.off < self.off[rows]
        at = rows[better]
        poses, residual_n, errors = self.poses.copy(), self.residual_n.copy(), self.errors.copy()
        poses[at], residual_n[at], errors[at] = other.poses[better], other.residual_n[better], other.errors[better]
        return _Found(poses, residual_n, errors)


def solve(problem: AssemblyPoses, start: Array | None = None, max_iterations: int = 300) -> AssemblyResult:
    """Settle the start, then solve with IPOPT; frames left unsolved begin again beside solved ones, `_ROUNDS` in all.

    start: poses (n, bodies, 6), each frame's own; if left out, every frame begins at its solved neighbour. Never raises
    for frames that do not converge: each is reported with its errors.
    """
    began = time.perf_counter()
    count = len(problem.cycle)
    best, outcome = _one_round(problem, start, max_iterations)
    iterations, loaded = outcome.iterations, _loaded(problem)
    for _ in range(_ROUNDS - 1):
        converged = best.converged(problem)
        if converged[loaded].all() or not converged.any():
            break
        rows = two_or_more(np.flatnonzero(~converged & loaded), count)
        beside = _beside_solved(problem, best.poses, converged)[rows]
        found, outcome = _one_round(build(problem.assembly, problem.cycle.frames(rows)), beside, max_iterations)
        best, iterations = best.or_better(found, rows), iterations + outcome.iterations
    poses, residual, errors, converged = best.poses, best.residual_n, best.errors, best.converged(problem)
    loads = np.asarray(problem.assembly.function().map(count)(poses.reshape(-1, 6).T)).T
    why = [_why(problem, *of_frame) for of_frame in zip(residual, errors, converged, loaded, strict=True)]
    reason = np.array(why, dtype=object)
    seconds = time.perf_counter() - began
    return AssemblyResult(
        poses,
        loads,
        residual,
        errors,
        converged,
        np.zeros(count, dtype=bool),
        reason,
        outcome.status,
        iterations,
        seconds,
    )


def _one_round(problem: AssemblyPoses, start: Array | None, max_iterations: int) -> tuple[_Found, IpoptOutcome]:
    """Settle, then solve all frames of a problem; of each frame the better of both."""
    poses = _settled(problem, start)
    options = least_squares_options(tolerance=_IPOPT_TOLERANCE, max_iterations=max_iterations)
    solver = ca.nlpsol("poses", "ipopt", problem.nlp, options)
    begin, held = problem.variables(poses), _held(problem)
    lower, upper = np.where(held, begin, problem.lower), np.where(held, begin, problem.upper)
    answer = solver(x0=begin, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    solved = np.asarray(problem.poses(answer["x"])).T.reshape(poses.shape)
    found = _Found.at(problem, poses).or_better(_Found.at(problem, solved), np.arange(len(poses)))
    return found, IpoptOutcome.of(solver)


def _loaded(problem: AssemblyPoses) -> np.ndarray:
    """True (n,) in frames whose measured contact presses (`PoseTargets.loaded`), or where none is measured."""
    return problem.measured.targets.loaded if problem.measured else np.ones(len(problem.cycle), dtype=bool)


def _held(problem: AssemblyPoses) -> np.ndarray:
    """True (variables,) for the measured body's in frames without load: in any pose out of contact it carries none, and
    IPOPT would go round and round among these."""
    held = np.zeros(len(problem.lower), dtype=bool)
    if problem.measured:
        each = np.repeat(~_loaded(problem), len(problem.measured.free))
        held[: len(each)] = each
    return held


def _beside_solved(problem: AssemblyPoses, poses: Array, solved: np.ndarray) -> Array:
    """Poses (n, bodies, 6) with every unsolved frame where the nearest solved one lies, but for what was measured."""
    frames, rows = np.arange(len(poses)), np.flatnonzero(solved)
    nearest = rows[np.abs(frames[:, None] - rows).argmin(axis=1)]
    moved = poses[nearest]
    for body, curves in problem.cycle.pose.items():
        for name, curve in curves.items():
            moved[:, problem.assembly.bodies.index(body), pose_index(name)] = curve
    return np.where(solved[:, None, None], poses, moved)


def _settled(problem: AssemblyPoses, start: Array | None) -> Array:
    """Poses (n, bodies, 6) of the start: the measured body settled under its loads, then the others beside it."""
    assembly, cycle, given = problem.assembly, problem.cycle, problem.start_poses()
    poses = given.copy() if start is None else start.copy()
    if problem.measured:
        body = assembly.bodies.index(problem.measured_body)
        poses[:, body] = problem.measured.settle_start(poses[:, body])
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


def _why(problem: AssemblyPoses, residual: float, errors: Array, converged: bool, loaded: bool) -> str:
    """Why a frame is not solved; "" if it is. loaded: whether its measured contact presses (`PoseTargets.loaded`)."""
    if converged:
        return ""
    missed = [f"{three_digits(residual)} N left on a body"] if residual > TOLERANCE_N else []
    if not loaded and not missed:
        return FrameOutcome.NO_LOAD.value
    if problem.measured:
        missed.append(problem.measured.targets.describe(errors) if loaded else FrameOutcome.NO_LOAD.value)
    return f"not found: {', '.join(missed)}"
