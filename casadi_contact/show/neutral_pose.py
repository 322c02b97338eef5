"""The pose to begin with: the bodies just touching."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.show.view import view_of

_OVERLAP_MM = 0.1
_FARTHEST_MM = 150.0


def neutral_pose(model: ElasticFoundation) -> Array:
    """The scene's start pose (6,), moved along the direction of pressing until the bodies overlap by 0.1 mm.

    Raises ValueError where that never brings them together.
    """
    scene = model.scene
    back = view_of(model).toward.pointing

    def posed(travel_mm: Array) -> Array:
        return scene.start_pose + np.pad(travel_mm[:, None] * back, ((0, 0), (0, 3)))

    travel = np.linspace(_FARTHEST_MM, -_FARTHEST_MM, 151)
    touching = np.flatnonzero(model.gaps(posed(travel)).min(axis=1) < -_OVERLAP_MM)
    if not touching.size or touching[0] == 0:
        raise ValueError(f"scene {scene.name} has no neutral pose along the direction of pressing: give a pose")
    low, high = travel[touching[0]], travel[touching[0] - 1]
    for _ in range(40):
        middle = 0.5 * (low + high)
        deep = model.gaps(posed(np.array([middle]))).min() < -_OVERLAP_MM
        low, high = (middle, high) if deep else (low, middle)
    return posed(np.array([low]))[0]
