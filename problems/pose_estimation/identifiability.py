"""Identifiability of a pose from its loads: frames in which contact carries the wanted loads a millimetre away too."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array
from problems.common.outcome import rows_in_words
from problems.pose_estimation.problem import PoseEstimation

AWAY_MM = 1.0  # turns count by 25 mm
_STEP_MM = 0.01
_TURNS = 3  # directions tried to each side: the first from where the pose is, others from where one before led
_BACK, _LARGEST_BACK_MM = 5, 0.5  # steps back onto the wanted loads, and how large one may be


def hardly_determined(problem: PoseEstimation, poses: Array) -> tuple[np.ndarray, Array]:
    """For poses (n, 6): True (n,) where in one `AWAY_MM` away or a little more no load that is wanted differs by more
    than the scene's tolerance, and the directions v (n, f) [mm] of the free parameters in which it lies.

    v is the right singular vector of the least singular value of ∂(loads/tolerances)/∂q: along a straight flank, or on
    a plane, forces do not change at all. Where they do, since the way along which they do not is curved, or a side that
    carries nothing just touches, Gauss-Newton steps across v lead back onto them.
    """
    model, columns = problem.model, problem.contact.columns
    names = problem.wanted.load_names
    tolerances = model.scene.tolerances_of(names)

    def loads(moves_mm: Array) -> Array:
        moved = poses.copy()
        moved[:, columns] += moves_mm / POSE_IN_MM[columns]
        return np.asarray(model(model.scene.pose_space.onto(moved), names) / tolerances)

    def slopes(moves_mm: Array) -> Array:
        """∂(loads/tolerances)/∂q (n, L, f) [1/mm] there."""
        steps = _STEP_MM * np.eye(len(columns))
        return np.stack(
            [(loads(moves_mm + step) - loads(moves_mm - step)) / (2.0 * _STEP_MM) for step in steps], axis=2
        )

    nowhere = np.zeros((len(poses), len(columns)))
    here, first = loads(nowhere), np.linalg.svd(slopes(nowhere))[2]
    changes, found = np.full(len(poses), np.inf), first[:, -1].copy()
    for sign in (1.0, -1.0):
        directions = first
        for _ in range(_TURNS):
            weakest, across = directions[:, -1], np.swapaxes(directions[:, :-1], 1, 2)
            moves = sign * AWAY_MM * weakest
            for _ in range(_BACK):
                off = loads(moves) - here
                back = (across @ (np.linalg.pinv(slopes(moves) @ across) @ off[..., None]))[..., 0]
                size = np.linalg.norm(back, axis=1, keepdims=True)
                moves = moves - back * np.minimum(1.0, _LARGEST_BACK_MM / np.maximum(size, 1e-300))
            change = np.abs(loads(moves) - here).max(axis=1)
            found = np.where((change < changes)[:, None], weakest, found)
            changes = np.minimum(changes, change)
            directions = np.linalg.svd(slopes(moves))[2]
            onwards = sign * np.einsum("nf,nf->n", directions[:, -1], moves)
            directions[:, -1] *= np.where(onwards < 0.0, -1.0, 1.0)[:, None]
    return changes <= 1.0, found


def hardly_determined_frames(problem: PoseEstimation, poses: Array, solved: np.ndarray) -> tuple[np.ndarray, Array]:
    """Which frames (n,) with load, of the solved ones (n,), are carried elsewhere, and their directions (m, f)."""
    found = solved & problem.wanted.loaded
    there, weakest = hardly_determined(problem, poses[found])
    found[found] = there
    return found, weakest[there]


def hardly_determined_in_words(problem: PoseEstimation, frames: np.ndarray, weakest: Array) -> str:
    """How many frames (n,) are carried elsewhere, which, and along what (m, f); "" for none."""
    if not frames.any():
        return ""
    names = " and ".join(problem.free[k] for k in np.unique(np.abs(weakest).argmax(axis=1)))
    return (
        f"the wanted loads hardly tell the pose in {frames.sum()} of {len(frames)} frames: {AWAY_MM:g} mm away, along "
        f"{names}, contact carries them within tolerance as well; measure {names}, or more loads: frames "
        f"{rows_in_words(frames)}"
    )
