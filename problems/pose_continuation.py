"""Frames that pose estimation leaves unsolved, continued on a reference contact model and along the cycle.

A surrogate knows only the range that it has learned, and near a rim a pose is found only from a start that is close.
So unsolved frames settle (Newton's method, exact Jacobian, no bounds) on the reference model, from where they stand;
else they are followed from a neighbour's equilibrium while loads and rotations change to the frame's own, in steps
halved where one fails. Where contact carries the same loads in several poses, the motion with the fewest leaps is taken
(`Motion.without_leaps`).
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace

import numpy as np

from casadi_contact.contact.continuity import Motion, follow
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.ipopt import FrameOutcome
from casadi_contact.optimisation.pose_estimation import PoseEstimation, PoseResult
from casadi_contact.optimisation.starts import pose_bounds


def continue_on(problem: PoseEstimation, result: PoseResult, reference: ContactModel | None = None) -> PoseResult:
    """The result without leaps where that can be, and with unsolved frames solved on the reference contact model.

    reference: a finer model of the same scene, such as its elements; the problem's own model if left out. A frame that
    is found on the reference is solved again on the problem's model from there, where that has learned the pose; else
    it stays ON_REFERENCE. With smoothness, which couples frames, the result stays as it is.
    """
    motion = motion_of(problem)
    if motion is None:
        return result
    began = time.perf_counter()
    poses = motion.without_leaps(result.poses, result.solved)
    moved = np.any(poses != result.poses, axis=1)
    if moved.any() and (tried := problem.evaluate(poses, result.ipopt)).solved[moved].all():
        result = replace(tried, seconds=result.seconds)
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


def _on_reference(problem: PoseEstimation, result: PoseResult, reference: ContactModel, left: np.ndarray) -> PoseResult:
    """The result with frames left (n,) found on the reference."""
    targets, names = problem.targets, problem.targets.load_names
    poses, found = _search(problem, result, reference, left)
    columns = [reference.load_names.index(name) for name in names]
    loads, outcome, final = result.loads.copy(), result.outcome.copy(), result.poses.copy()
    rows = np.flatnonzero(left & found)
    loads[rows] = reference(poses[rows])[:, columns]
    rows = rows[targets.met(targets.errors(loads))[rows]]
    final[rows] = poses[rows]
    outcome[rows] = FrameOutcome.SOLVED
    outcome[problem.settle_rows(final, rows)] = FrameOutcome.ON_REFERENCE
    own = outcome != FrameOutcome.ON_REFERENCE
    loads[own] = problem.model(final[own], names)
    return replace(result, poses=final, loads=loads, errors=targets.errors(loads), outcome=outcome)


def _search(
    problem: PoseEstimation, result: PoseResult, model: ContactModel, left: np.ndarray
) -> tuple[Array, np.ndarray]:
    """Poses (n, 6) that meet the targets on a model, of the frames left (n,), and which are found (n,)."""
    poses, found = result.poses.copy(), result.solved.copy()
    loads, tolerance_n = problem.targets.as_loads() or {}, problem.targets.settle_tolerance_n
    given = {name: curve[left] for name, curve in loads.items()}
    settled, report = settle(model, poses[left], problem.free, given, tolerance=float(tolerance_n[left].min()))
    rows = np.flatnonzero(left)[report.converged]
    poses[rows], found[rows] = settled[report.converged], True
    waiting = deque((k, k + step) for k in np.flatnonzero(found).tolist() for step in (-1, 1))
    while waiting:
        begin, frame = waiting.popleft()
        if not 0 <= frame < len(poses) or found[frame] or not left[frame]:
            continue
        now, then = ({name: curve[at] for name, curve in loads.items()} for at in (begin, frame))
        pose, share = follow(model, poses[begin], poses[frame], problem.free, now, then, tolerance_n[frame])
        if share == 1.0:
            poses[frame], found[frame] = pose, True
            waiting.extend([(frame, frame - 1), (frame, frame + 1)])
    return poses, found
