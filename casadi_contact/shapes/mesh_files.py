"""A scene of two mesh files: its [geometry], where its files lie, and what they held when the scene was loaded.

    [geometry]
    moving = "femoral_component.stl"      # STL, OBJ, PLY or VTP; a path is relative to the scene file
    fixed = "tibial_insert.stl"           # carries the elements
    units = "m"                           # of both files, "m" or "mm"
    axes = ["-x", "y", "-z"]              # which file axis x, y and z are; as in the file if left out
    elements = "grid"                     # rays down -y onto the fixed mesh; or "triangles": each one an element
    spacing = 0.75                        # of the distance field's nodes [mm]
    [geometry.patches.med]                # in the order of the patches; bounds in mm in the library's axes
    x = [-20.0, 20.0]                     # where the patch's elements lie; no bound if left out
    z = [3.0, 40.0]
    anchor = [0.0, 0.0, 22.0]             # on the moving body, about where it touches this patch; else its origin
    split_z = [17.0]                      # where it touches in several places: cut into parts, learned apart

Loading a scene file makes the paths absolute and adds the files' SHA-256; the scene's digest holds the latter only,
so that a scene stays the same scene wherever its files lie, and another one when a mesh changes.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from casadi_contact.geometry.mesh import FILE_AXES, MM_PER_UNIT, axes_rotation
from casadi_contact.shapes.checks import fail, identifier, number, table_of

BODIES = ("moving", "fixed")
ELEMENTS = ("grid", "triangles")
_DIGESTS = {body: f"{body}_sha256" for body in BODIES}
_NEEDED = (*BODIES, "units", "patches")
_KNOWN = (*_NEEDED, "axes", "elements", "spacing", *_DIGESTS.values())
_DEFAULTS: dict[str, Any] = {"axes": list(FILE_AXES), "elements": "grid", "spacing": 0.75}


def check_mesh_geometry(table: object) -> dict[str, Any]:
    """The [geometry] of a mesh scene with its defaults filled in; raises ValueError naming the key at fault."""
    values: dict[str, Any] = _DEFAULTS | table_of("geometry", table, _KNOWN, complete=False)
    missing = [key for key in _NEEDED if key not in values]
    if missing:
        raise ValueError(f"scene: geometry lacks {', '.join(missing)}")
    for key in (*BODIES, *(key for key in _DIGESTS.values() if key in values)):
        if not isinstance(values[key], str) or not values[key]:
            raise fail(f"geometry.{key}", values[key], "text")
    for key, allowed in (("units", MM_PER_UNIT), ("elements", ELEMENTS)):
        if values[key] not in tuple(allowed):
            raise fail(f"geometry.{key}", values[key], " or ".join(allowed))
    axes_rotation(values["axes"])
    values["spacing"] = number("geometry.spacing", values["spacing"], low=0.0)
    patches = values["patches"]
    if not isinstance(patches, Mapping) or not patches:
        raise fail("geometry.patches", patches, "a table for each patch, e.g. [geometry.patches.med]")
    for name in patches:
        identifier("geometry.patches (a patch's name)", name)
    values["patches"] = {name: _patch(f"geometry.patches.{name}", patch) for name, patch in patches.items()}
    return values


def _patch(key: str, table: object) -> dict[str, list[float]]:
    values = table_of(key, table, ("x", "z", "anchor", "split_z"), complete=False)
    for name, length in (("x", 2), ("z", 2), ("anchor", 3)):
        listed = values.get(name, [0.0, 1.0, 2.0][:length])
        if not isinstance(listed, list | tuple) or len(listed) != length:
            raise fail(f"{key}.{name}", listed, f"{length} numbers [mm]")
        for value in listed:
            number(f"{key}.{name}", value)
        if length == 2 and listed[0] >= listed[1]:
            raise fail(f"{key}.{name}", listed, "two rising numbers [mm]")
    if "split_z" in values:
        _check_cuts(f"{key}.split_z", values["split_z"], values.get("z"))
    return values


def _check_cuts(key: str, cuts: object, bounds: Sequence[float] | None) -> None:
    if bounds is None:
        raise ValueError(f"scene: {key} = {cuts!r} needs the patch's z, its bounds [mm]")
    expected = f"a list of rising numbers between {bounds[0]:g} and {bounds[1]:g} [mm]"
    if not isinstance(cuts, list | tuple):
        raise fail(key, cuts, expected)
    ends = [bounds[0], *(number(key, value) for value in cuts), bounds[1]]
    if any(a >= b for a, b in itertools.pairwise(ends)):
        raise fail(key, cuts, expected)


def with_files(geometry: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The [geometry] with absolute mesh paths (relative ones start at the folder) and the files' digests.

    Raises FileNotFoundError for a missing mesh, ValueError for one that is not the one the scene was made with.
    """
    found = dict(geometry)
    for body, key in _DIGESTS.items():
        path = (folder / geometry[body]).resolve()
        digest = file_digest(path)
        if geometry.get(key, digest) != digest:
            raise ValueError(f"scene: geometry.{body}: {path} has changed since the scene was made with it")
        found |= {body: str(path), key: digest}
    return found


def without_places(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """The [geometry] with each mesh named by its digest (if known) instead of its path."""
    return {key: value for key, value in geometry.items() if _DIGESTS.get(key) not in geometry}


def file_digest(path: Path) -> str:
    """SHA-256 of a mesh file; raises FileNotFoundError, saying how a scene finds its meshes."""
    if not path.is_file():
        raise FileNotFoundError(
            f"mesh file {path} does not exist: a scene's mesh paths are absolute or relative to the scene file"
        )
    return hashlib.sha256(path.read_bytes()).hexdigest()
