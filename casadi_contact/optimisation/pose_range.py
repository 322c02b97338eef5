"""The range of poses that a contact model knows, as arrays."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.statics import first_touch


def pose_bounds(model: SymbolicContact) -> tuple[Array, Array]:
    """Lowest and highest pose (6,), (6,) [mm, rad] that a surrogate has learned, infinite where it does not say; a
    foundation knows no bounds."""
    ranges = model.record.get("pose_range", {})
    pairs = np.array([ranges.get(name, (-np.inf, np.inf)) for name in POSE_NAMES])
    return pairs[:, 0], pairs[:, 1]


def middle_pose(model: SymbolicContact) -> Array:
    """The middle (6,) of the learned range; where there is none, the first touch from the scene's start pose.

    A scene whose patches are pressed in no single direction begins in its start pose, a model without gaps likewise.
    """
    (low, high), space = pose_bounds(model), model.scene.pose_space
    known = np.isfinite(low) & np.isfinite(high)
    if known.any():
        pairs = zip(low, high, known, strict=True)
        return space.onto(np.array([0.5 * (a + b) if both else 0.0 for a, b, both in pairs]))
    start = space.onto(model.scene.start_pose)
    directed = model.scene.normal_loads[0].direction is not None
    return first_touch(model, start[None], {})[0] if directed and hasattr(model, "gaps") else start
