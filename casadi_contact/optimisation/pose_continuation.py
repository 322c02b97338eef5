"""Frames that pose estimation leaves unsolved, continued on a reference contact model and along the cycle.

A surrogate knows only the range that it has learned, and near a rim a pose is found only from a start that is close.
So unsolved frames settle (Newton's method, exact Jacobian, no bounds) on the reference model, from where they stand;
else they are followed from a neighbour's equilibrium while loads and rotations change to the frame's own, in steps
halved where one fails; else they begin at the middle pose. Where contact carries the same loads in several poses, the
motion with the fewest leaps is taken (`Motion.without_leaps`).
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from casadi_contact.contact.continuity import Motion, follow
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, pose_index
from casadi_contact.optimisation.ipopt import FrameOutcome
from casadi_contact.optimisation.pose_estimation import PoseEstimation, PoseResult
from casadi_contact.optimisation.starts import pose_bounds


def continue_on(problem: PoseEstimation, result: PoseResult, reference: ContactModel | None = None) -> PoseResult:
    """The result without leaps where that can be, and with unsolved frames solved on the reference contact model.

    reference: a finer model of the same scene, such as its elements; the problem's own model if left out. A frame that
    is found on the reference is solved again on the problem's model from there, where that has learned the pose; else
    it stays ON_REFERENCE. With smoothness, which couples frames, the result stays as it is.
    """
    loads = problem.targets.as_loads()
    if problem.smoothness > 0.0 or not loads:
        return result
    began = time.perf_counter()
    result = without_leaps(problem, result)
    left = (result.outcome == FrameOutcome.NOT_SOLVED) & problem.targets.loaded
    if left.any():
        result = _on_reference(problem, result, reference or problem.model, left)
    return replace(result, seconds=result.seconds + time.perf_counter() - began)


def motion_of(problem: PoseEstimation) -> Motion | None:
    """The problem's frames as a motion to be followed; None with smoothness, and where centres of pressure are targets
    without the forces that they belong to."""
    loads, targets = problem.targets.as_loads(), problem.targets
    if problem.smoothness > 0.0 or not loads:
        return None
    low, high = pose_bounds(problem.model)
    tolerance_n = np.minimum(targets.settle_tolerance_n, 1e-4)
    return Motion(problem.model, problem.free, loads, tolerance_n, targets.loaded, low, high)


def without_leaps(problem: PoseEstimation, result: PoseResult) -> PoseResult:
    """The result with frames moved to other poses that meet their targets, where the motion then leaps less."""
    motion = motion_of(problem)
    if motion is None:
        return result
    poses = motion.without_leaps(result.poses, result.solved)
    moved = np.any(poses != result.poses, axis=1)
    tried = problem.evaluate(poses, result.ipopt)
    return replace(tried, seconds=result.seconds) if moved.any() and tried.solved[moved].all() else result


def _on_reference(problem: PoseEstimation, result: PoseResult, reference: ContactModel, left: np.ndarray) -> PoseResult:
    """The result with frames left (n,) found on the reference."""
    targets, names = problem.targets, problem.targets.load_names
    poses, found = _search(problem, result, reference, left)
    columns = [reference.load_names.index(name) for name in names]
    loads, outcome, iterations = result.loads.copy(), result.outcome.copy(), 0
    rows = np.flatnonzero(left & found)
    loads[rows] = reference(poses[rows])[:, columns]
    rows = rows[targets.met(targets.errors(loads))[rows]]
    frame_solver = problem.frame_solver()
    final = result.poses.copy()
    begin = problem.contact.variables(poses).reshape(len(poses), -1)
    for k in rows.tolist():
        answer, spent = frame_solver.solve(begin[k], k) if problem.in_range(poses[[k]])[0] else (None, 0)
        iterations += spent
        if answer is None:
            final[k], outcome[k] = poses[k], FrameOutcome.ON_REFERENCE
        else:
            final[[k]], outcome[k] = problem.contact.poses_with(poses[[k]], answer), FrameOutcome.SOLVED
    own = outcome != FrameOutcome.ON_REFERENCE
    loads[own] = problem.model(final[own], names)
    return replace(
        result,
        poses=final,
        loads=loads,
        errors=targets.errors(loads),
        outcome=outcome,
        ipopt=result.ipopt.plus(iterations),
    )


def _search(
    problem: PoseEstimation, result: PoseResult, model: ContactModel, left: np.ndarray
) -> tuple[Array, np.ndarray]:
    """Poses (n, 6) that meet the targets on a model, of the frames left (n,), and which are found (n,)."""
    poses, found = result.poses.copy(), result.solved.copy()
    loads, tolerance_n = problem.targets.as_loads() or {}, problem.targets.settle_tolerance_n
    measured = {pose_index(name): curve for name, curve in problem.measured.items()}
    tried: set[tuple[int, int]] = set()

    def settle_from(rows: np.ndarray, begin: Array) -> None:
        for tolerance in np.unique(tolerance_n[rows]):
            some = rows[tolerance_n[rows] == tolerance]
            start = begin[some]
            for column, curve in measured.items():
                start[:, column] = curve[some]
            given = {name: curve[some] for name, curve in loads.items()}
            settled, report = settle(model, start, problem.free, given, tolerance=tolerance)
            poses[some[report.converged]] = settled[report.converged]
            found[some[report.converged]] = True

    def follow_neighbours() -> None:
        """From each neighbour that is found, once, until no new frame is."""
        while pairs := _pairs(left & ~found, found) - tried:
            tried.update(pairs)
            for frame, neighbour in sorted(pairs):
                if found[frame]:
                    continue
                to = poses[frame].copy()
                for column, curve in measured.items():
                    to[column] = curve[frame]
                now, then = ({name: curve[at] for name, curve in loads.items()} for at in (neighbour, frame))
                pose, share = follow(model, poses[neighbour], to, problem.free, now, then, tolerance_n[frame])
                if share == 1.0:
                    poses[frame], found[frame] = pose, True

    settle_from(np.flatnonzero(left), poses)
    follow_neighbours()
    rows = np.flatnonzero(left & ~found)
    if len(rows):
        middle, sensitive = problem.contact.start_poses(), problem.model.scene.sensitive_pose
        forces = {name: curve[rows] for name, curve in problem.targets.pressing.items()}
        if forces and set(sensitive) <= set(problem.free):
            middle[rows], _ = settle(model, middle[rows], sensitive, forces, tolerance=1.0)
        settle_from(rows, middle)
        follow_neighbours()
    return poses, found


def _pairs(missing: np.ndarray, found: np.ndarray) -> set[tuple[int, int]]:
    """Frames missing (n,), each with a neighbour that is found (n,)."""
    frames = np.flatnonzero(missing).tolist()
    return {(k, j) for k in frames for j in (k - 1, k + 1) if 0 <= j < len(found) and found[j]}
