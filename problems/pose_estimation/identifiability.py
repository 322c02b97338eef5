"""Identifiability of a pose from its loads: frames in which contact carries the wanted loads a millimetre away too."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import POSE_IN_MM, Array
from problems.common.outcome import rows_in_words
from problems.pose_estimation.problem import PoseEstimation

AWAY_MM = 1.0  # turns count by 25 mm
_STEP_MM = 0.01


def hardly_determined(problem: PoseEstimation, poses: Array) -> tuple[np.ndarray, Array]:
    """For poses (n, 6): True (n,) where in one `AWAY_MM` away no load that is wanted differs by more than the scene's
    tolerance, and the directions v (n, f) [mm] of the free parameters in which it lies.

    v is the right singular vector of the least singular value of ∂(loads/tolerances)/∂q: along a straight flank, or on
    a plane, forces do not change at all.
    """
    model, columns = problem.model, problem.contact.columns
    names = problem.wanted.load_names
    tolerances = model.scene.tolerances_of(names)

    def loads(moves_mm: Array) -> Array:
        moved = poses.copy()
        moved[:, columns] += moves_mm / POSE_IN_MM[columns]
        return np.asarray(model(model.scene.pose_space.onto(moved), names) / tolerances)

    steps = [np.tile(step, (len(poses), 1)) for step in _STEP_MM * np.eye(len(columns))]
    slopes = np.stack([loads(step) - loads(-step) for step in steps], axis=2)
    weakest = np.linalg.svd(slopes)[2][:, -1]
    here = model(poses, names) / tolerances
    changes = [np.abs(loads(sign * AWAY_MM * weakest) - here).max(axis=1) for sign in (1.0, -1.0)]
    return np.min(changes, axis=0) <= 1.0, weakest


def hardly_determined_in_words(problem: PoseEstimation, poses: Array, solved: np.ndarray) -> str:
    """How many of the solved frames (n,) of poses (n, 6) are carried elsewhere, which, and along what; "" for none."""
    found = solved & problem.wanted.loaded
    there, weakest = hardly_determined(problem, poses[found])
    found[found] = there
    if not there.any():
        return ""
    names = " and ".join(problem.free[k] for k in np.unique(np.abs(weakest[there]).argmax(axis=1)))
    return (
        f"the wanted loads hardly tell the pose in {there.sum()} of {len(poses)} frames: {AWAY_MM:g} mm away, along "
        f"{names}, contact carries them within tolerance as well; measure {names}, or more loads: frames "
        f"{rows_in_words(found)}"
    )
