"""The range of poses that a surrogate has learned, as arrays."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.structures import Surrogate


def pose_bounds(surrogate: Surrogate) -> tuple[Array, Array]:
    """Lowest and highest pose (6,), (6,) [mm, rad] that the surrogate has learned, infinite where it does not say."""
    ranges = surrogate.record.get("pose_range", {})
    pairs = np.array([ranges.get(name, (-np.inf, np.inf)) for name in POSE_NAMES])
    return pairs[:, 0], pairs[:, 1]


def middle_pose(surrogate: Surrogate) -> Array:
    """The middle (6,) of the learned range, 0 where there is none."""
    low, high = pose_bounds(surrogate)
    return np.where(np.isfinite(low + high), 0.5 * (low + high), 0.0)
