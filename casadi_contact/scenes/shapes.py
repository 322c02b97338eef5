"""The shapes a scene can have: what each needs in [geometry], its patches and their anchors on the moving body."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.scenes.checks import fail, number, table_of
from casadi_contact.scenes.joint_shapes import JOINT_PARAMETERS, JOINT_PATCHES, check_joint_geometry, joint_anchors
from casadi_contact.scenes.mesh_files import check_mesh_geometry
from casadi_contact.scenes.own_model import OWN_MODEL, check_own_geometry, own_anchors

# What each shape needs in [geometry]; lengths in mm, angles in degrees, areas in mm².
SHAPE_PARAMETERS: dict[str, tuple[str, ...]] = {
    "knee": (
        "sagittal_radii",
        "sagittal_junctions_deg",
        "frontal_radius",
        "condyle_offset",
        "dish_sagittal_radius",
        "dish_frontal_radius",
        "plateau_length",
        "plateau_width",
    ),
    "sphere_on_plane": ("radius", "patch_side"),
    "sphere_in_dish": ("radius", "dish_radius", "patch_side"),
    "cylinder_on_plane": ("radius", "length", "patch_side"),
    "punch_on_plane": ("area",),
    **JOINT_PARAMETERS,
    OWN_MODEL: ("patches",),
    "mesh": (),  # see `scenes.mesh_files`
}
SIDES = ("med", "lat")


def patches_of(shape: str, geometry: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of a scene's patches, in order."""
    if shape in ("mesh", OWN_MODEL):
        return tuple(geometry["patches"])
    return SIDES if shape == "knee" else JOINT_PATCHES.get(shape, ("contact",))


def check_geometry(shape: str, table: object) -> dict[str, Any]:
    """The [geometry] of a scene, checked; raises ValueError naming the key at fault."""
    if shape == "mesh":
        return check_mesh_geometry(table)
    known = SHAPE_PARAMETERS[shape]
    if shape != "knee":
        values = table_of("geometry", table, known, complete=True)
        if shape == OWN_MODEL:
            return check_own_geometry(values)
        if shape in JOINT_PARAMETERS:
            return check_joint_geometry(shape, values)
        numbers = {key: number(f"geometry.{key}", value, low=0.0) for key, value in values.items()}
        if shape == "sphere_in_dish":
            limit = max(numbers["radius"], numbers["patch_side"] / math.sqrt(2.0))
            if numbers["dish_radius"] <= limit:
                raise fail("geometry.dish_radius", numbers["dish_radius"], f"more than {limit:g} (sphere, half patch)")
        return numbers
    values = table_of("geometry", table, (*known, *SIDES), complete=False)
    missing = [key for key in known if key not in values]
    if missing:
        raise ValueError(f"scene: geometry lacks {', '.join(missing)}")
    for side in SIDES:
        if side in values:
            values[side] = table_of(f"geometry.{side}", values[side], known, complete=False)
        _check_knee_side(side, {k: v for k, v in values.items() if k not in SIDES} | values.get(side, {}))
    return values


def _check_knee_side(side: str, values: Mapping[str, Any]) -> None:
    radii, junctions = values["sagittal_radii"], values["sagittal_junctions_deg"]
    for key, listed in (("sagittal_radii", radii), ("sagittal_junctions_deg", junctions)):
        if not isinstance(listed, list | tuple):
            raise fail(f"geometry.{key}", listed, "a list of numbers")
        for value in listed:
            number(f"geometry.{key}", value, low=-60.0 if key.endswith("deg") else 0.0, high=180.0)
    if len(junctions) != len(radii) - 1 or any(a >= b for a, b in itertools.pairwise(junctions)):
        raise fail("geometry.sagittal_junctions_deg", junctions, f"{len(radii) - 1} rising angles between the arcs")
    for key in SHAPE_PARAMETERS["knee"][2:]:
        number(f"geometry.{key}", values[key], low=0.0)
    # A condyle more curved than its dish has one contact region; half the patch must lie inside the dish's circle.
    limits = {
        "dish_frontal_radius": max(values["frontal_radius"], 0.5 * values["plateau_width"]),
        "dish_sagittal_radius": max(*radii, 0.5 * values["plateau_length"]),
    }
    for key, limit in limits.items():
        if values[key] <= limit:
            raise fail(f"geometry.{key} ({side})", values[key], f"more than {limit:g} (condyle and half patch)")


def anchors_of(shape: str, geometry: Mapping[str, Any]) -> Array:
    """Anchor of each patch on the moving body [mm]: a condyle's centre, or the body's own origin."""
    if shape == "mesh":
        return np.array([patch.get("anchor", [0.0, 0.0, 0.0]) for patch in geometry["patches"].values()], dtype=float)
    if shape == OWN_MODEL:
        return own_anchors(geometry)
    if shape in JOINT_PARAMETERS:
        return joint_anchors(shape)
    if shape != "knee":
        return np.zeros((1, 3))
    offsets = [geometry.get(side, {}).get("condyle_offset", geometry["condyle_offset"]) for side in SIDES]
    return np.array([[0.0, 0.0, offsets[0]], [0.0, 0.0, -offsets[1]]])
