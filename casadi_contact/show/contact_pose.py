"""A pose in contact, to begin with: the bodies overlap by a tenth of a millimetre."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.show.view import view_of

_OVERLAP_MM = 0.1
_FARTHEST_MM = 150.0


def contact_pose(model: ElasticFoundation) -> Array:
    """The scene's start pose (6,), moved along the direction of pressing until the bodies overlap by 0.1 mm.

    Raises ValueError where that never brings them together.
    """
    scene = model.scene
    back = view_of(model).toward.pointing

    def pose_at(travel_mm: Array) -> Array:
        return scene.pose_space.onto(scene.start_pose + np.pad(travel_mm[:, None] * back, ((0, 0), (0, 3))))

    travel = np.linspace(_FARTHEST_MM, -_FARTHEST_MM, 151)
    touching = np.flatnonzero(model.gaps(pose_at(travel)).min(axis=1) < -_OVERLAP_MM)
    if not touching.size or touching[0] == 0:
        raise ValueError(f"scene {scene.name} has no contact along the direction of pressing: give a pose")
    low, high = travel[touching[0]], travel[touching[0] - 1]
    for _ in range(40):
        middle = 0.5 * (low + high)
        deep = model.gaps(pose_at(np.array([middle]))).min() < -_OVERLAP_MM
        low, high = (middle, high) if deep else (low, middle)
    return pose_at(np.array([low]))[0]
