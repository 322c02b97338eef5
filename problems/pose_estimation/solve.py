"""The solution of pose estimation: all frames in one problem, then those left unsolved from solved neighbours."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.approach import loading_directions
from casadi_contact.contact.continuity import Motion
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.starts import pose_bounds, start_or_default, touching
from problems.pose_estimation.march import FrameSolver, march
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.wanted import NO_LOAD, off_by

_SETTLED_N = 0.01
_BEYOND_TOUCH_MM = (0.05, 0.5)  # of stiff layers, and of soft ones
_FOLLOWED_N = 1e-4  # or closer
_FRAME_ITERATIONS = 100  # of a frame alone
# IPOPT scales by the gradient at the start: begun at the solution, it then asks for the impossible. With this scale
# and its tolerance gradients end below 1e-5 N², residuals below about 1e-7 N.
SCALING: dict[str, Any] = {"nlp_scaling_method": "none", "obj_scaling_factor": 1e-3}


@dataclass(frozen=True)
class PoseResult:
    """Poses (n, 6), the model's loads there (n, L) as in the problem's ``wanted.load_names``, errors (n, wanted) of
    what is wanted, and what became of each frame.

    on_model (n,): True for frames that are solved on the contact model itself, with its loads (`complete`);
    on_rim (n,): for those of them whose contact reaches the edge of the fixed body.
    """

    poses: Array
    loads: Array
    errors: Array
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
    """Bring the start into the learned range, settle it under the wanted normal loads, then solve with IPOPT.

    start: poses (n, 6), `PoseEstimation.start_poses` if left out. alone: frames left unsolved are solved alone from
    their solved neighbours (without smoothness, which couples frames; `march`). Never raises for frames that do not
    converge: each is reported with its errors and the reason. Frames without load stay where they begin, but for
    smoothness, which moves them between their neighbours.
    """
    contact, loaded = problem.contact, problem.wanted.loaded
    began = time.perf_counter()
    poses = settled(problem, start_or_default(start, problem.start_poses()))
    options = ipopt_options(max_iterations=max_iterations, print_level=print_level, **SCALING)
    solver = ca.nlpsol("pose_estimation", "ipopt", problem.nlp, options)
    begin = contact.variables(poses)
    held = np.repeat(~loaded & (problem.smoothness == 0.0), len(problem.free))
    answer = solver(x0=begin, lbx=np.where(held, begin, contact.lower), ubx=np.where(held, begin, contact.upper))
    outcome = IpoptOutcome.of(solver)
    x = np.asarray(answer["x"]).reshape(problem.frames, -1)
    poses = contact.moved(poses, x)
    result = _result(problem, poses, outcome, outcome.iterations, time.perf_counter() - began)
    close = result.converged[loaded]
    if not alone or problem.smoothness > 0.0 or close.all() or not close.any():
        return result
    frames = x[loaded]
    more = march(frame_solver(problem, print_level), frames, problem.parameters[loaded], close)
    x[loaded] = frames
    poses = contact.moved(poses, x)
    return _result(problem, poses, outcome, outcome.iterations + more, time.perf_counter() - began)


def settled(problem: PoseEstimation, poses: Array) -> Array:
    """Poses (n, 6) brought into the learned range, the sensitive parameters settled under the wanted normal loads.

    Settling needs the range: outside it s may have another root, from which IPOPT does not come back. Poses from which
    it fails, such as a ball beyond the rim of its cup, settle from `PoseEstimation.start_poses` at the first touch.
    Where only parts of normal loads are wanted, poses that do not settle begin again at the first touch along these.
    Then all free parameters settle under all that is wanted, frame by frame: what Newton's method solves there leaves
    IPOPT 8 iterations in place of 21 on the built-in walk, and saves more on meshes, with many spots of contact.
    """
    model, columns = problem.model, problem.contact.columns
    low, high = pose_bounds(model)
    poses[:, columns] = np.clip(poses[:, columns], low[columns], high[columns])
    for name, curve in problem.measured.items():
        poses[:, pose_index(name)] = curve
    poses = model.scene.pose_space.onto(poses)
    pressing, targets, sensitive = problem.wanted.pressing, problem.wanted.targets(), model.scene.sensitive_pose
    frames = np.arange(len(poses))
    if not pressing:
        return _settled_from_touch(problem, poses, _settled_under(problem, poses, frames, targets))
    if not set(sensitive) <= set(problem.free):
        return poses
    poses, report = settle(model, poses, sensitive, pressing, tolerance=0.1, max_iterations=30)
    left = np.flatnonzero(~report.converged)
    if len(left):
        forces = {name: curve[left] for name, curve in pressing.items()}
        begin = touching(model, problem.start_poses()[left], problem.free, forces)
        again, report = settle(model, begin, sensitive, forces, tolerance=0.1, max_iterations=30)
        poses[left[report.converged]] = again[report.converged]
    _settled_under(problem, poses, frames, targets)
    return poses


def _settled_from_touch(problem: PoseEstimation, poses: Array, left: np.ndarray) -> Array:
    """The poses, these rows of them settled from a little beyond the first touch along the parts of normal loads that
    are wanted: at the touch itself loads have no slope."""
    model, targets = problem.model, problem.wanted.targets()
    if not targets or not len(left):
        return poses
    forces = problem.wanted.partly_pressing(left)
    poses[left] = touching(model, poses[left], problem.free, forces)
    touched, along = poses.copy(), np.zeros((len(poses), 3))
    along[left] = loading_directions(model, len(left), forces)
    along[:, [name not in problem.free for name in POSE_NAMES[:3]]] = 0.0
    for beyond_mm in _BEYOND_TOUCH_MM:
        poses[left, :3] = touched[left, :3] + beyond_mm * along[left]
        left = _settled_under(problem, poses, left, targets)
    return poses


def _settled_under(
    problem: PoseEstimation, poses: Array, rows: np.ndarray, targets: Mapping[str, Array] | None
) -> np.ndarray:
    """Settle all free parameters of these rows of poses under all that is wanted, in place where that leads to a pose
    inside the learned range; returns the rows that it does not."""
    if not targets or not len(rows):
        return rows
    low, high = pose_bounds(problem.model)
    wanted = {name: curve[rows] for name, curve in targets.items()}
    found, report = settle(problem.model, poses[rows], problem.free, wanted, tolerance=_SETTLED_N, max_iterations=60)
    columns = problem.contact.columns
    good = report.converged & ((found >= low) & (found <= high))[:, columns].all(axis=1)
    poses[rows[good]] = found[good]
    return rows[~good]


def motion_of(problem: PoseEstimation) -> Motion | None:
    """A problem's frames, to be followed from one to the next; None with smoothness, which couples frames, and where
    centres of pressure are wanted without the forces that they belong to."""
    targets = problem.wanted.targets()
    if problem.smoothness > 0.0 or not targets:
        return None
    tolerance_n = np.minimum(problem.wanted.settled_n, _FOLLOWED_N)
    low, high = pose_bounds(problem.model)
    return Motion(problem.model, problem.free, targets, tolerance_n, problem.wanted.loaded, low, high)


def without_leaps(problem: PoseEstimation, result: PoseResult) -> PoseResult:
    """The result with frames moved to other poses that carry what is wanted, where the motion then leaps less
    (`Motion.without_leaps`)."""
    motion = motion_of(problem)
    if motion is None:
        return result
    began = time.perf_counter()
    poses = motion.without_leaps(result.poses, result.converged & problem.wanted.loaded)
    moved = np.any(poses != result.poses, axis=1)
    if not moved.any():
        return result
    loads = result.loads.copy()
    loads[moved] = problem.model(poses[moved], problem.wanted.load_names)
    errors = problem.wanted.errors(loads)
    if not problem.wanted.carried(errors)[moved].all():  # settled, but not as closely as a frame is to be
        return result
    return replace(
        result,
        poses=poses,
        loads=loads,
        errors=errors,
        converged=result.converged | moved,
        reason=np.where(moved, "", result.reason),
        seconds=result.seconds + time.perf_counter() - began,
    )


def frame_solver(problem: PoseEstimation, print_level: int = 0) -> FrameSolver:
    """Of `PoseEstimation.one_frame`."""
    options = ipopt_options(max_iterations=_FRAME_ITERATIONS, print_level=print_level, **SCALING)
    solver = ca.nlpsol("one_frame", "ipopt", problem.one_frame(), options)
    lower, upper = (bound[: len(problem.free)] for bound in (problem.contact.lower, problem.contact.upper))
    return FrameSolver(solver, lower, upper)


def _result(
    problem: PoseEstimation, poses: Array, outcome: IpoptOutcome, iterations: int, seconds: float
) -> PoseResult:
    """Errors of each frame, and whether it carries the wanted loads."""
    wanted = problem.wanted
    loads = problem.model(poses, wanted.load_names)
    errors = wanted.errors(loads)
    # Without smoothness frames stand alone: one that carries its loads is solved, whatever IPOPT met in another.
    converged = wanted.carried(errors) & (outcome.solved or problem.smoothness == 0.0)
    reason = np.full(problem.frames, "", dtype=object)
    ended = f"not found{problem.within}" if outcome.solved else f"IPOPT stopped ({outcome.status})"
    for k in np.flatnonzero(~converged):
        reason[k] = f"{ended}: {off_by(wanted.values, errors[k])} at the nearest" if wanted.loaded[k] else NO_LOAD
    none = np.zeros(problem.frames, dtype=bool)
    return PoseResult(poses, loads, errors, converged, none, none, reason, outcome.status, iterations, seconds)
