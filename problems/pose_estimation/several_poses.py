"""Where contact carries the wanted loads in several poses: what there is to say of the one that was found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from casadi_contact.statics import leaps_in_words
from problems.common.outcome import rows_in_words
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.solve import PoseResult, motion_of


def unstable_frames(problem: PoseEstimation, result: PoseResult) -> np.ndarray:
    """True (n,) for solved frames in which the wanted forces alone hold the body in an unstable equilibrium."""
    motion, found = motion_of(problem), result.converged & problem.wanted.loaded
    found[found] = False if motion is None else motion.unstable(result.poses[found])
    return found


def several_poses_in_words(problem: PoseEstimation, result: PoseResult, leaping: np.ndarray) -> Iterator[str]:
    """Which free pose parameters leap, where frames do (n,), and which frames stand in an unstable equilibrium."""
    if leaping.any() and (words := leaps_in_words(result.poses, problem.free)):
        yield (
            f"the pose leaps: {words}; contact carries the wanted loads in several poses, and none that was found "
            "leads from one side to the other: measure more of the pose, or more loads"
        )
    unstable = unstable_frames(problem, result)
    if unstable.any():
        yield (
            f"in {unstable.sum()} of {problem.frames} frames contact alone holds the body in an unstable equilibrium "
            "of the wanted forces, from which it would slide; something else must hold it there: frames "
            f"{rows_in_words(unstable)}"
        )
