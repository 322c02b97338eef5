"""Where contact carries the wanted loads in several poses: what there is to say of the one that was found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from casadi_contact.contact.continuity import leaps_in_words
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.trust import VALID
from problems.common.outcome import rows_in_words
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.solve import PoseResult, motion_of

_ASIDE_MM = (2.0, 4.0)
_OTHER_MM = 1.0


def unstable_frames(problem: PoseEstimation, result: PoseResult) -> np.ndarray:
    """True (n,) for solved frames in which the wanted forces alone hold the body in an unstable equilibrium."""
    motion, found = motion_of(problem), result.converged & problem.wanted.loaded
    found[found] = False if motion is None else motion.unstable(result.poses[found])
    return found


def elsewhere_mm(problem: PoseEstimation, result: PoseResult) -> Array:
    """How far (n,) [mm, turns count by 25 mm] from each solved frame's pose lies the farthest one found that carries
    the wanted loads as well; 0 where none was found nor looked for (`motion_of`).

    Newton's method begins `_ASIDE_MM` to both sides along each free translation, and ends in stable and unstable
    equilibria alike. A pose counts within the learned range, from `_OTHER_MM` on. A user's own model may refuse poses
    aside (ValueError): then none is found.
    """
    motion, away = motion_of(problem), np.zeros(problem.frames)
    frames = np.flatnonzero(result.converged & problem.wanted.loaded)
    if motion is None or not len(frames):
        return away
    moves = [sign * size for size in _ASIDE_MM for sign in (1.0, -1.0)]
    sides = [(pose_index(name), move) for name in motion.free if name[0] == "t" for move in moves]
    if not sides:
        return away
    starts = np.repeat(result.poses[frames][None], len(sides), axis=0)
    for start, (column, move) in zip(starts, sides, strict=True):
        start[:, column] += move
    wanted = {
        name: np.tile(np.broadcast_to(load, problem.frames)[frames], len(sides)) for name, load in motion.wanted.items()
    }
    tolerance = float(np.min(motion.tolerance_n[frames]))
    try:
        poses, settled = settle(
            motion.model, starts.reshape(-1, 6), motion.free, wanted, tolerance=tolerance, trust_region=False
        )
    except ValueError:
        return away
    inside = ((poses >= motion.low) & (poses <= motion.high))[:, motion.columns].all(axis=1)
    if isinstance(motion.model, Surrogate) and motion.model.trust is not None:
        inside &= motion.model.validity(poses) > VALID
    steps = (poses.reshape(starts.shape) - result.poses[frames]) * POSE_IN_MM
    found = np.linalg.norm(steps[..., motion.columns], axis=-1)
    found = np.where((settled.converged & inside).reshape(found.shape) & (found >= _OTHER_MM), found, 0.0)
    away[frames] = found.max(axis=0)
    return away


def several_poses_in_words(
    problem: PoseEstimation, result: PoseResult, leaping: np.ndarray, elsewhere: Array
) -> Iterator[str]:
    """Which free pose parameters leap, where frames do (n,), which frames are carried elsewhere as well (n,) [mm], and
    which stand in an unstable equilibrium."""
    if leaping.any() and (words := leaps_in_words(result.poses, problem.free)):
        yield (
            f"the pose leaps: {words}; contact carries the wanted loads in several poses, and none that was found "
            "leads from one side to the other: measure more of the pose, or more loads"
        )
    if (other := elsewhere > 0.0).any():
        yield (
            f"contact carries the wanted loads of {other.sum()} of {problem.frames} frames in another pose as well, up "
            f"to {elsewhere.max():.3g} mm away, and loads cannot tell which is the body's: measure more of the pose or "
            f"more loads, or begin beside the other (--start): frames {rows_in_words(other)}"
        )
    unstable = unstable_frames(problem, result)
    if unstable.any():
        yield (
            f"in {unstable.sum()} of {problem.frames} frames contact alone holds the body in an unstable equilibrium "
            "of the wanted forces, from which it would slide; something else must hold it there: frames "
            f"{rows_in_words(unstable)}"
        )
