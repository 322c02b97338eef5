"""Two bodies of mesh files, each with a smooth surface through its mesh's vertices.

    [geometry]
    moving = "femoral_component.stl"      # STL, OBJ, PLY or VTP; a path is relative to the scene file
    fixed = "tibial_insert.stl"           # carries the elements
    units = "m"                           # of both files, "m" or "mm"
    axes = ["-x", "y", "-z"]              # which file axis x, y and z are; as in the file if left out
    pressing = [0.0, -1.0, 0.0]           # where to the moving body presses; the elements lie on the side that faces it
    cup_centre = [0.0, 10.0, 5.0]         # of a deep cup, in the fixed body's frame [mm]: rays run from here instead
    start_pose = [0.0, 40.0, 0.0, 0.0, 0.0, 0.0]  # tx, ty, tz [mm], rx, ry, rz [rad]; zero if left out
    shell = "outer"                       # of a moving mesh that is a thin shell: only its side away from the
                                          # anchors counts; or "whole": overlaps stay far below its thickness
    open_edges = "cut"                    # of the fixed mesh; or "rim": the part itself ends there, contact may too
    elements = "grid"                     # rays along `pressing` onto the fixed mesh; or "triangles": its own
    spacing = 0.75                        # of the distance fields' nodes [mm]; or {moving = 0.75, fixed = 0.2}
    [geometry.placement.moving]           # where each mesh lies in its body's frame; as in the file if left out
    mirror = "z"                          # first mirrored, then turned as a pose turns, then moved [mm]
    rotation_deg = [0.0, 0.0, 5.0]
    offset = [0.0, -10.0, 0.0]
    [geometry.patches.med]                # in the order of the patches; bounds in mm in the fixed body's frame
    x = [-20.0, 20.0]                     # where the patch's elements lie, likewise y; no bound if left out
    z = [3.0, 40.0]
    anchor = [0.0, 0.0, 22.0]             # on the moving body, about where it touches this patch; else its origin
    pressing = [-1.0, 0.0, 0.0]           # of this patch alone: a post's wall, a ridge that another direction sees
    split_z = [17.0]                      # cut into parts along z, learned apart

Loading a scene file makes the paths absolute and adds the files' SHA-256; the scene's digest holds the latter only,
so that a scene stays the same scene wherever its files lie, and another one when a mesh changes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import Cells, ElementGrid, grid_elements, scattered_elements
from casadi_contact.geometry.mesh import FILE_AXES, MIRRORS, MM_PER_UNIT, axes_rotation, file_digest
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.scenes.shapes.checks import fail, identifier, number, table_of
from casadi_contact.scenes.shapes.own_model import patch_anchors
from casadi_contact.scenes.shapes.shape import Geometry, Range, Shape

BODIES = ("moving", "fixed")
ELEMENTS = ("grid", "triangles")
OPEN_EDGES = ("cut", "rim")
SHELLS = ("outer", "whole")
_SPACINGS_MM = {"low": 1e-3, "high": 1.5}  # finer does not fit into memory, coarser loses a joint's surface
_DIGESTS = {body: f"{body}_sha256" for body in BODIES}
_NEEDED = (*BODIES, "units", "patches")
_LISTS = {"pressing": 3, "cup_centre": 3, "start_pose": 6}
_KNOWN = (
    *(*_NEEDED, "axes", "elements", "spacing", "open_edges", "shell", "placement"),
    *(*_LISTS, *_DIGESTS.values()),
)
_DEFAULTS: dict[str, Any] = {"axes": list(FILE_AXES), "elements": "grid", "spacing": 0.75, "open_edges": "cut"}


def check_mesh_geometry(table: object) -> dict[str, Any]:
    """The [geometry] of a mesh scene with its defaults filled in; raises ValueError naming the key at fault."""
    values: dict[str, Any] = _DEFAULTS | table_of("geometry", table, _KNOWN, complete=False)
    missing = [key for key in _NEEDED if key not in values]
    if missing:
        raise ValueError(f"scene: geometry lacks {', '.join(missing)}")
    for key in (*BODIES, *(key for key in _DIGESTS.values() if key in values)):
        if not isinstance(values[key], str) or not values[key]:
            raise fail(f"geometry.{key}", values[key], "text")
    for key, allowed in (("units", MM_PER_UNIT), ("elements", ELEMENTS), ("open_edges", OPEN_EDGES)):
        if values[key] not in tuple(allowed):
            raise fail(f"geometry.{key}", values[key], " or ".join(allowed))
    if values.get("shell", "whole") not in SHELLS:
        raise fail("geometry.shell", values["shell"], " or ".join(SHELLS))
    axes_rotation(values["axes"])
    for key, length in _LISTS.items():
        if key in values:
            values[key] = _numbers(f"geometry.{key}", values[key], length)
    if "pressing" in values:
        _check_direction("geometry.pressing", values["pressing"])
    values["placement"] = {
        body: _placement(f"geometry.placement.{body}", table)
        for body, table in table_of("geometry.placement", values.get("placement", {}), BODIES, complete=False).items()
    }
    values["spacing"] = _spacing(values["spacing"])
    patches = values["patches"]
    if not isinstance(patches, Mapping) or not patches:
        raise fail("geometry.patches", patches, "a table for each patch, e.g. [geometry.patches.med]")
    for name in patches:
        identifier("geometry.patches (a patch's name)", name)
    values["patches"] = {name: _patch(f"geometry.patches.{name}", patch) for name, patch in patches.items()}
    return values


def _spacing(value: object) -> float | dict[str, float]:
    if not isinstance(value, Mapping):
        return number("geometry.spacing", value, **_SPACINGS_MM)
    each = table_of("geometry.spacing", value, BODIES, complete=True)
    return {body: number(f"geometry.spacing.{body}", each[body], **_SPACINGS_MM) for body in BODIES}


def _patch(key: str, table: object) -> dict[str, Any]:
    values = table_of(key, table, ("x", "y", "z", "anchor", "pressing", "split_z"), complete=False)
    for name, length in (("x", 2), ("y", 2), ("z", 2), ("anchor", 3)):
        listed = _numbers(f"{key}.{name}", values.get(name, [0.0, 1.0, 2.0][:length]), length)
        if length == 2 and listed[0] >= listed[1]:
            raise fail(f"{key}.{name}", listed, "two rising numbers [mm]")
    if "pressing" in values:
        _check_direction(f"{key}.pressing", _numbers(f"{key}.pressing", values["pressing"], 3))
    if "split_z" in values:
        _check_cuts(f"{key}.split_z", values["split_z"], values.get("z"))
    return values


def _check_direction(key: str, direction: list[float]) -> None:
    if math.hypot(*direction) < 1e-6:
        raise fail(key, direction, "a direction, for example [0.0, -1.0, 0.0]")


def _numbers(key: str, value: object, length: int) -> list[float]:
    if not isinstance(value, list | tuple) or len(value) != length:
        unit = "tx, ty, tz [mm], rx, ry, rz [rad]" if length == 6 else "[mm]"
        raise fail(key, value, f"{length} numbers {unit}")
    return [number(key, each) for each in value]


def _placement(key: str, table: object) -> dict[str, Any]:
    values = table_of(key, table, ("mirror", "rotation_deg", "offset"), complete=False)
    for name in ("rotation_deg", "offset"):
        if name in values:
            values[name] = _numbers(f"{key}.{name}", values[name], 3)
    if values.get("mirror", "x") not in MIRRORS:
        raise fail(f"{key}.mirror", values["mirror"], " or ".join(MIRRORS))
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
    located = dict(geometry)
    for body, key in _DIGESTS.items():
        path = (folder / geometry[body]).resolve()
        digest = file_digest(path)
        if geometry.get(key, digest) != digest:
            raise ValueError(f"scene: geometry.{body}: {path} has changed since the scene was made with it")
        located |= {body: str(path), key: digest}
    return located


def without_places(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """The [geometry] with each mesh named by its digest (if known) instead of its path."""
    return {key: value for key, value in geometry.items() if _DIGESTS.get(key) not in geometry}


class Mesh(Shape):
    """The moving body is the distance field of its mesh; elements lie on the smooth surface of the fixed one.

    Numba and the readers of meshes load when a surface is first built, not with every scene.
    """

    name = "mesh"
    mesh_bodies = BODIES

    def check(self, table: object) -> dict[str, Any]:
        """Files, units, axes and patches, with the defaults filled in."""
        return check_mesh_geometry(table)

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        """As named."""
        return tuple(geometry["patches"])

    def anchors(self, geometry: Geometry) -> Array:
        """As given."""
        return patch_anchors(geometry)

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        """The moving mesh's field, which faces every patch."""
        from casadi_contact.scenes.shapes.mesh_bodies import body_field, check_shells

        check_shells(geometry)
        field = body_field(geometry, "moving")
        return [MovingSurface(MESH_FIELD, field.parameters)] * len(geometry["patches"])

    def start_pose(self, geometry: Geometry) -> Array:
        """As given, or zero."""
        return np.array(geometry.get("start_pose", np.zeros(6)))

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        """Grids laid over each patch of the fixed mesh, from where the moving body presses it."""
        from casadi_contact.geometry.mesh_elements import grid_on_mesh
        from casadi_contact.scenes.shapes.mesh_bodies import (
            body_field,
            body_surface,
            check_patches,
            check_shared,
            patch_box,
            patch_mesh,
            patch_projection,
        )

        check_patches(geometry)
        field, cells = body_field(geometry, "fixed"), []
        for patch in geometry["patches"]:
            mesh, box = patch_mesh(geometry, patch, reaching=True), patch_box(geometry, patch)
            projection = patch_projection(geometry, patch)
            cells.append(grid_on_mesh(mesh, field, grid, box, projection, partial(body_surface, geometry, "fixed")))
        check_shared(geometry, cells)
        return cells

    def elements(
        self, geometry: Geometry, grid: tuple[int, int], z_ranges_mm: Sequence[Sequence[Range]]
    ) -> list[ElementGrid]:
        """As of any shape, or each patch's triangles, whatever the grid; outermost are those where the patch is cut."""
        from casadi_contact.geometry.mesh_elements import open_triangles, triangles_on_mesh
        from casadi_contact.scenes.shapes.mesh_bodies import (
            body_field,
            check_patches,
            check_shared,
            cut_cells,
            patch_mesh,
        )

        field, elements = body_field(geometry, "fixed"), []
        if geometry["elements"] == "grid":
            for patch, cells, ranges in zip(geometry["patches"], self.cells(geometry, grid), z_ranges_mm, strict=True):
                centres, normals, areas = cells
                cut = cut_cells(geometry, patch, cells, field)
                elements += [grid_elements(centres, normals, areas, z_mm, cut) for z_mm in ranges]
            return elements
        check_patches(geometry)
        meshes = [patch_mesh(geometry, patch) for patch in geometry["patches"]]
        triangles = [triangles_on_mesh(mesh, field) for mesh in meshes]
        check_shared(geometry, triangles)
        for mesh, (centres, normals, areas), ranges in zip(meshes, triangles, z_ranges_mm, strict=True):
            outermost = open_triangles(mesh)
            elements += [scattered_elements(centres, normals, areas, outermost, z_mm) for z_mm in ranges]
        return elements

    def locate_files(self, geometry: Geometry, folder: Path) -> Geometry:
        """Absolute paths of the mesh files, and their digests."""
        return with_files(geometry, folder)

    def identity(self, geometry: Geometry) -> Geometry:
        """The files' digests instead of their paths."""
        return without_places(geometry)
