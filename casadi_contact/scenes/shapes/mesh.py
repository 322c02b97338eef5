"""Two bodies of mesh files, each with a smooth surface through its mesh's vertices.

    [geometry]
    moving = "femoral_component.stl"      # STL, OBJ, PLY, VTP, VTK or OFF; relative to the scene file
    fixed = "tibial_insert.stl"           # carries the elements
    units = "m"                           # of both files, "m" or "mm"
    axes = ["-x", "y", "-z"]              # which file axis x, y and z are; as in the file if left out
    pressing = [0.0, -1.0, 0.0]           # where to the moving body presses; the elements lie on the side that faces it
    elements = "grid"                     # rays along `pressing` onto the fixed mesh; or "triangles": its own
    spacing = 0.75                        # of the distance fields' nodes [mm]; or {moving = 0.75, fixed = 0.2}
    backing = "tibia_bone.stl"            # what the fixed body's layer lies on, in the fixed mesh's units, axes and
                                          # placement: the layer is as thick as the way to it along the normal
    [geometry.patches.med]                # in the order of the patches; bounds in mm in the fixed body's frame
    x = [-20.0, 20.0]                     # where the patch's elements lie, likewise y; no bound if left out
    z = [3.0, 40.0]
    anchor = [0.0, 0.0, 22.0]             # on the moving body, about where it touches this patch; else its origin

Other keys stand in docs/how-to/meshes.md. Loading a scene file makes the paths absolute and adds the files' SHA-256;
the digest holds the latter only, so that a scene is the same wherever its files lie, and another when a mesh changes.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import CellGrid, ElementGrid, grid_elements, scattered_elements
from casadi_contact.geometry.mesh import FILE_AXES, MM_PER_UNIT, axes_rotation, file_digest
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface, half_space
from casadi_contact.scenes.shapes.checks import fail, identifier, number, numbers, table_of
from casadi_contact.scenes.shapes.shape import Geometry, Shape, patch_anchors

BODIES = ("moving", "fixed")
_CHOICES: dict[str, Sequence[str]] = {
    "units": tuple(MM_PER_UNIT),
    "elements": ("grid", "triangles"),
    "open_edges": ("cut", "rim"),
    "shell": ("outer", "whole"),
}
_SPACINGS_MM = {"low": 1e-3, "high": 1.5}  # finer does not fit into memory, coarser loses a joint's surface
_FILES = (*BODIES, "backing")
_DIGESTS = {file: f"{file}_sha256" for file in _FILES}
_LISTS = {"pressing": 3, "cup_centre": 3, "start_pose": 6}
_OPTIONAL = (*_CHOICES, "backing", "axes", "spacing", "placement", *_LISTS, *_DIGESTS.values())
_DEFAULTS: dict[str, Any] = {"axes": list(FILE_AXES), "elements": "grid", "spacing": 0.75, "open_edges": "cut"}


def _patch(key: str, table: object) -> dict[str, Any]:
    values = table_of(key, table, ("x", "y", "z", "anchor", "pressing"), complete=False)
    for name, length in (("x", 2), ("y", 2), ("z", 2), ("anchor", 3), ("pressing", 3)):
        if name in values:
            listed = _list(f"{key}.{name}", values[name], length)
            if length == 2 and listed[0] >= listed[1]:
                raise fail(f"{key}.{name}", listed, "two rising numbers [mm]")
    return values


def _list(key: str, value: object, length: int) -> list[float]:
    """So many numbers, and of a direction to press in not only zeros."""
    listed = numbers(key, value, length, "mm, mm, mm, rad, rad, rad" if length == 6 else "mm")
    if key.endswith("pressing") and math.hypot(*listed) < 1e-6:
        raise fail(key, value, "a direction, for example [0.0, -1.0, 0.0]")
    return listed


def _placement(key: str, table: object) -> dict[str, Any]:
    values = table_of(key, table, ("mirror", "rotation_deg", "offset"), complete=False)
    for name in sorted({"rotation_deg", "offset"} & set(values)):
        values[name] = _list(f"{key}.{name}", values[name], 3)
    if values.get("mirror", "x") not in FILE_AXES:
        raise fail(f"{key}.mirror", values["mirror"], " or ".join(FILE_AXES))
    return values


class Mesh(Shape):
    """The moving body is the distance field of its mesh; elements lie on the smooth surface of the fixed one. Numba and
    the readers of meshes load when a surface is first built, not with every scene."""

    name = "mesh"
    mesh_bodies: ClassVar[tuple[str, ...]] = BODIES

    def check(self, table: object) -> dict[str, Any]:
        needed = (*self.mesh_bodies, "units", "patches")
        values: dict[str, Any] = _DEFAULTS | table_of("geometry", table, needed, complete=True, optional=_OPTIONAL)
        for key in sorted({*_FILES, *_DIGESTS.values()} & set(values)):
            if not isinstance(values[key], str) or not values[key]:
                raise fail(f"geometry.{key}", values[key], "text")
        for key in sorted(set(_CHOICES) & set(values)):
            if values[key] not in _CHOICES[key]:
                raise fail(f"geometry.{key}", values[key], " or ".join(_CHOICES[key]))
        axes_rotation(values["axes"])
        for key in sorted(set(_LISTS) & set(values)):
            values[key] = _list(f"geometry.{key}", values[key], _LISTS[key])
        placed = table_of("geometry.placement", values.get("placement", {}), BODIES, complete=False)
        values["placement"] = {body: _placement(f"geometry.placement.{body}", each) for body, each in placed.items()}
        if isinstance(spacing := values["spacing"], Mapping):
            spacings = table_of("geometry.spacing", spacing, BODIES, complete=True)
            values["spacing"] = {k: number(f"geometry.spacing.{k}", v, **_SPACINGS_MM) for k, v in spacings.items()}
        else:
            values["spacing"] = number("geometry.spacing", spacing, **_SPACINGS_MM)
        if not isinstance(values["patches"], Mapping) or not values["patches"]:
            raise fail("geometry.patches", values["patches"], "a table for each patch, e.g. [geometry.patches.med]")
        for name in values["patches"]:
            identifier("geometry.patches (a patch's name)", name)
        values["patches"] = {name: _patch(f"geometry.patches.{name}", each) for name, each in values["patches"].items()}
        return values

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return tuple(geometry["patches"])

    def anchors(self, geometry: Geometry) -> Array:
        return patch_anchors(geometry)

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        from casadi_contact.scenes.shapes import mesh_bodies as bodies

        bodies.check_shells(geometry)
        field = bodies.body_field(geometry, "moving")
        return [MovingSurface(MESH_FIELD, field.parameters)] * len(geometry["patches"])

    def start_pose(self, geometry: Geometry) -> Array:
        return np.array(geometry.get("start_pose", np.zeros(6)))

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        """Grids laid over each patch of the fixed mesh, from where the moving body presses it."""
        from casadi_contact.geometry.projection import grid_on_mesh
        from casadi_contact.scenes.shapes import mesh_bodies as bodies

        bodies.check_patches(geometry)
        field, surface = bodies.body_field(geometry, "fixed"), partial(bodies.body_surface, geometry, "fixed")
        cells = []
        for patch in geometry["patches"]:
            mesh, box = bodies.patch_mesh(geometry, patch, reaching=True), bodies.patch_box(geometry, patch)
            cells.append(grid_on_mesh(mesh, field, grid, box, bodies.patch_projection(geometry, patch), surface))
        bodies.check_shared(geometry, cells)
        return cells

    def elements(self, geometry: Geometry, grid: tuple[int, int]) -> list[ElementGrid]:
        """As of any shape, or each patch's triangles, whatever the grid; outermost are those where the patch is cut."""
        from casadi_contact.geometry.projection import triangles_on_mesh
        from casadi_contact.scenes.shapes import mesh_bodies as bodies

        field = bodies.body_field(geometry, "fixed")
        if geometry["elements"] == "grid":
            patches = zip(geometry["patches"], self.cells(geometry, grid), strict=True)
            return [grid_elements(*cells, bodies.cut_cells(geometry, name, cells, field)) for name, cells in patches]
        bodies.check_patches(geometry)
        meshes = [bodies.patch_mesh(geometry, patch) for patch in geometry["patches"]]
        triangles = [triangles_on_mesh(mesh, field) for mesh in meshes]
        bodies.check_shared(geometry, triangles)
        patches = zip(meshes, triangles, strict=True)
        return [scattered_elements(*of_patch, mesh.open_corners.any(axis=1)) for mesh, of_patch in patches]

    def thickness_at(self, geometry: Geometry, points_mm: Array, normals: Array) -> Array | None:
        """The way to the backing along the inward normals, where the scene names one."""
        from casadi_contact.scenes.shapes import mesh_bodies as bodies

        return bodies.backing_depths(geometry, points_mm, normals) if "backing" in geometry else None

    def locate_files(self, geometry: Geometry, folder: Path) -> Geometry:
        """Absolute paths of the mesh files (relative ones start at the folder), and the files' digests. Raises
        FileNotFoundError for a missing mesh, ValueError for one that is not the one the scene was made with."""
        located = dict(geometry)
        for body, key in _DIGESTS.items():
            if body not in geometry:
                continue
            path = (folder / geometry[body]).resolve()
            digest = file_digest(path)
            if geometry.get(key, digest) != digest:
                raise ValueError(f"scene: geometry.{body}: {path} has changed since the scene was made with it")
            located |= {body: str(path), key: digest}
        return located

    def identity(self, geometry: Geometry) -> Geometry:
        """The files' digests, where they are known, instead of their paths."""
        return {key: value for key, value in geometry.items() if _DIGESTS.get(key) not in geometry}


class MeshOnGround(Mesh):
    """A mesh, the fixed body, on a half-space: the ground, which moves and fills y <= 0 of its own frame."""

    name = "mesh_on_ground"
    mesh_bodies = ("fixed",)

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        from casadi_contact.scenes.shapes.mesh_bodies import check_shells

        check_shells(geometry)
        return [half_space(-1.0)] * len(geometry["patches"])
