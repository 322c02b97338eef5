"""Two bodies of mesh files (see `shapes.mesh_files`), each with a smooth surface through its mesh's vertices."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import Cells, ElementGrid, grid_elements, scattered_elements
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.scenes.shapes.mesh_files import BODIES, check_mesh_geometry, with_files, without_places
from casadi_contact.scenes.shapes.own_model import patch_anchors
from casadi_contact.scenes.shapes.shape import Geometry, Range, Shape


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
        from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_surface, patch_box
        from casadi_contact.scenes.shapes.mesh_patches import (
            check_patches,
            check_shared,
            check_side,
            patch_mesh,
            patch_projection,
        )

        check_patches(geometry)
        field, found = body_field(geometry, "fixed"), []
        for patch in geometry["patches"]:
            mesh, box = patch_mesh(geometry, patch, reaching=True), patch_box(geometry, patch)
            projection = patch_projection(geometry, patch)
            found.append(grid_on_mesh(mesh, field, grid, box, projection, partial(body_surface, geometry, "fixed")))
        check_shared(geometry, found)
        for patch, cells in zip(geometry["patches"], found, strict=True):
            check_side(geometry, patch, cells)
        return found

    def elements(
        self, geometry: Geometry, grid: tuple[int, int], z_ranges_mm: Sequence[Sequence[Range]]
    ) -> list[ElementGrid]:
        """As of any shape, or each patch's triangles, whatever the grid; outermost are those where the patch is cut."""
        from casadi_contact.geometry.mesh_elements import open_triangles, triangles_on_mesh
        from casadi_contact.scenes.shapes.mesh_bodies import body_field
        from casadi_contact.scenes.shapes.mesh_patches import check_patches, check_shared, cut_cells, patch_mesh

        field, found = body_field(geometry, "fixed"), []
        if geometry["elements"] == "grid":
            for patch, cells, ranges in zip(geometry["patches"], self.cells(geometry, grid), z_ranges_mm, strict=True):
                centres, normals, areas = cells
                cut = cut_cells(geometry, patch, cells, field)
                found += [grid_elements(centres, normals, areas, z_mm, cut) for z_mm in ranges]
            return found
        check_patches(geometry)
        meshes = [patch_mesh(geometry, patch) for patch in geometry["patches"]]
        triangles = [triangles_on_mesh(mesh, field) for mesh in meshes]
        check_shared(geometry, triangles)
        for mesh, (centres, normals, areas), ranges in zip(meshes, triangles, z_ranges_mm, strict=True):
            outermost = open_triangles(mesh)
            found += [scattered_elements(centres, normals, areas, outermost, z_mm) for z_mm in ranges]
        return found

    def locate_files(self, geometry: Geometry, folder: Path) -> Geometry:
        """Absolute paths of the mesh files, and their digests."""
        return with_files(geometry, folder)

    def identity(self, geometry: Geometry) -> Geometry:
        """The files' digests instead of their paths."""
        return without_places(geometry)
