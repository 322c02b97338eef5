"""Parametric joints beside the knee: a ball in a cup, and a button that rides in a groove.

``ball_in_cup``: an elastic spherical cup, fixed; its deepest point lies from ``cup_centre`` along ``cup_pole``, and
it reaches ``cup_half_angle_deg`` to every side of it. The moving body is a ball about its own origin.

``button_in_groove``: an elastic groove, fixed, revolved about the fixed z axis and open towards -x. Each of its two
facets is an arc of ``facet_radius`` in the plane through the z axis; ``facet_offset`` to the side of the middle it
lies ``groove_radius`` from the axis and slopes by ``facet_angle_deg``. Its elements reach ``facet_half_width_deg``
along the arc and ``groove_half_angle_deg`` about the axis, to both sides. The moving button has its dome about its
own z axis, of ``dome_sagittal_radius`` (about that axis) and ``dome_radius`` (in the planes through it).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from casadi_contact.conventions import Array

JOINT_PARAMETERS: dict[str, tuple[str, ...]] = {
    "ball_in_cup": ("ball_radius", "cup_radius", "cup_half_angle_deg", "cup_pole", "cup_centre"),
    "button_in_groove": (
        "groove_radius",
        "groove_half_angle_deg",
        "facet_radius",
        "facet_angle_deg",
        "facet_offset",
        "facet_half_width_deg",
        "dome_radius",
        "dome_sagittal_radius",
    ),
}
JOINT_PATCHES = {"ball_in_cup": ("contact",), "button_in_groove": ("med", "lat")}
_VECTORS = ("cup_pole", "cup_centre")
_MOST_DEGREES = 89.0


def check_joint_geometry(shape: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The complete [geometry] of a joint with its numbers checked; raises ValueError naming the key at fault."""
    checked: dict[str, Any] = {}
    for key in JOINT_PARAMETERS[shape]:
        value, vector = values[key], key in _VECTORS
        numbers = list(value) if vector and isinstance(value, list | tuple) else [value]
        if (vector and len(numbers) != 3) or not all(
            isinstance(n, int | float) and not isinstance(n, bool) and np.isfinite(n) for n in numbers
        ):
            raise _fail(key, value, "three finite numbers" if vector else "a finite number")
        if not vector and not 0.0 < value < (_MOST_DEGREES if key.endswith("_deg") else np.inf):
            raise _fail(key, value, f"a number above 0{f', below {_MOST_DEGREES:g}' if key.endswith('_deg') else ''}")
        checked[key] = [float(n) for n in numbers] if vector else float(value)
    if shape == "ball_in_cup":
        _more("cup_radius", checked, "ball_radius")
        if not np.linalg.norm(checked["cup_pole"]) > 0.0:
            raise _fail("cup_pole", values["cup_pole"], "a direction, not zero")
    else:
        _more("facet_radius", checked, "dome_radius")
        if checked["dome_sagittal_radius"] < checked["dome_radius"]:
            raise _fail("dome_sagittal_radius", checked["dome_sagittal_radius"], "at least dome_radius")
        if checked["facet_angle_deg"] + checked["facet_half_width_deg"] >= _MOST_DEGREES:
            raise _fail("facet_half_width_deg", checked["facet_half_width_deg"], "facets that do not turn back")
    return checked


def joint_anchors(shape: str) -> Array:
    """Anchors of the patches on the moving body: the ball's centre, the middle of the dome."""
    return np.zeros((len(JOINT_PATCHES[shape]), 3))


def joint_start(geometry: Mapping[str, Any]) -> Array:
    """A pose (6,) from which the body can move into contact: centred in the cup, or the fixed origin."""
    return np.array([*geometry.get("cup_centre", (0.0, 0.0, 0.0)), 0.0, 0.0, 0.0])


def _more(key: str, values: Mapping[str, Any], than: str) -> None:
    if values[key] <= values[than]:
        raise _fail(key, values[key], f"more than {than} ({values[than]:g})")


def _fail(key: str, got: object, expected: str) -> ValueError:
    return ValueError(f"scene: geometry.{key} = {got!r}, expected {expected}")
