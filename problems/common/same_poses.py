"""When two solutions are the same."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import POSE_IN_MM, Array

_SAME_MM = 0.01  # rotations over 25 mm


def same_poses(poses: Array, reference: Array) -> np.ndarray:
    """True (n,) where poses (n, 6) differ by less than 0.01 mm, rotations over 25 mm."""
    return np.asarray(np.abs((poses - reference) * POSE_IN_MM).max(axis=1) < _SAME_MM)
