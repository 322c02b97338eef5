"""How a page looks at a scene: the map from where the moving body lies, and words for the sliders' directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import ANATOMY, POSE_NAMES, Array
from casadi_contact.core.quantities import ANGLE, quantity
from casadi_contact.pictures.view import anatomical_name, direction_formula, view_of
from casadi_contact.scenes.shapes.shape import shape_named

_TURNS = {"rx": "Ab-/adduction", "ry": "Axial rotation", "rz": "Flexion"}
_RIGHT_HANDED = {"rx": ("−", "+"), "ry": ("−", "+"), "rz": ("flexed", "extended")}
_EYE_SHARES = (0.62, 0.75, 0.25)  # towards the viewer of the map, its top, its right: where the eye is at first
_DISTANCE = 4.4  # of the eye, in half extents of the fixed surface


def map_view(model: ElasticFoundation, extent_mm: float) -> dict[str, Any]:
    """Directions to the right, up and towards the viewer of the pressure map, with their names, and the first eye.

    A surface that is pressed from above or below is shown with anterior up, any other with superior up.
    """
    toward = view_of(model).toward.pointing
    rough = np.array([-1.0, 0.0, 0.0]) if abs(toward[1]) > np.sqrt(0.5) else np.array([0.0, 1.0, 0.0])
    up = rough - (rough @ toward) * toward
    up /= np.linalg.norm(up)
    right = np.cross(up, toward)
    name = anatomical_name if shape_named(model.scene.shape).anatomical else direction_formula
    ways = {"right": right, "left": -right, "top": up, "bottom": -up}
    eye = sum(share * way for share, way in zip(_EYE_SHARES, (toward, up, right), strict=True))
    positive = up if up[np.abs(up).argmax()] > 0.0 else -up
    return {
        "right": right.tolist(),
        "up": up.tolist(),
        "toward": toward.tolist(),
        "names": {way: name(direction) for way, direction in ways.items()},
        "alongName": direction_formula(positive),
        "alongSign": 1 if positive is up else -1,
        "eye": (eye / np.linalg.norm(eye)).tolist(),
        "distance": _DISTANCE * extent_mm,
    }


def pose_words(scene_shape: str, ranges: Array) -> list[dict[str, Any]]:
    """Name, label, unit, range and the words at both ends of each pose parameter."""
    anatomical = shape_named(scene_shape).anatomical
    found = []
    for name, bounds in zip(POSE_NAMES, ranges.tolist(), strict=True):
        axis = name[1]
        if quantity(name).kind == ANGLE:
            label, ends = (_TURNS[name], _RIGHT_HANDED[name]) if anatomical else (name, ("−", "+"))
        else:
            grows, falls = ANATOMY[axis] if anatomical else ("+", "−")
            label, ends = (f"{falls.capitalize()}–{grows}", (falls, grows)) if anatomical else (name, ("", ""))
        found.append({"name": name, "label": label, "unit": quantity(name).unit, "range": bounds, "ends": list(ends)})
    return found
