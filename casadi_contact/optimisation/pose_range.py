"""The range of poses that a contact model knows, as arrays."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.contact.touch import touching_start
from casadi_contact.conventions import POSE_NAMES, Array


def pose_bounds(model: SymbolicContact) -> tuple[Array, Array]:
    """Lowest and highest pose (6,), (6,) [mm, rad] that a surrogate has learned, infinite where it does not say; a
    foundation knows no bounds."""
    ranges = model.record.get("pose_range", {})
    pairs = np.array([ranges.get(name, (-np.inf, np.inf)) for name in POSE_NAMES])
    return pairs[:, 0], pairs[:, 1]


def middle_pose(model: SymbolicContact) -> Array:
    """The middle (6,) of the learned range; where there is none, `touching_start`, and likewise where the patches are
    pressed in no single direction: in a cup the middle touches nothing, and no direction leads from there to contact.
    """
    (low, high), space = pose_bounds(model), model.scene.pose_space
    known = np.isfinite(low) & np.isfinite(high)
    if known.any() and model.scene.normal_loads[0].direction is not None:
        pairs = zip(low, high, known, strict=True)
        return space.onto(np.array([0.5 * (a + b) if both else 0.0 for a, b, both in pairs]))
    return touching_start(model)
