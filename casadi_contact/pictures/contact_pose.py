"""A pose in contact, to begin with: the bodies overlap by a tenth of a millimetre."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.approach import first_crossing
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.pictures.view import view_of

_OVERLAP_MM = 0.1
_FARTHEST_MM = 150.0


def contact_pose(model: ElasticFoundation) -> Array:
    """The scene's start pose (6,), moved along the direction of pressing until the bodies overlap by 0.1 mm.

    Raises ValueError where that never brings them together.
    """
    scene = model.scene
    back = view_of(model).toward.pointing

    def pose_at(travel_mm: Array) -> Array:
        return scene.pose_space.project(scene.start_pose + np.pad(travel_mm[:, None] * back, ((0, 0), (0, 3))))

    def overlaps(_: np.ndarray, way_mm: Array) -> np.ndarray:
        return model.gaps(pose_at(_FARTHEST_MM - way_mm)).min(axis=1) < -_OVERLAP_MM

    step_mm, reach_mm = 2.0, 2.0 * _FARTHEST_MM
    way_mm = first_crossing(overlaps, 1, step_mm, reach_mm, bisections=40)
    if not step_mm < way_mm[0] < reach_mm:
        raise ValueError(f"scene {scene.name} has no contact along the direction of pressing: give a pose")
    return pose_at(_FARTHEST_MM - way_mm)[0]
