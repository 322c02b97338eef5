"""A total-knee implant: two condyles of sagittal arcs, moving, each in a dish of its own, fixed.

Each number of [geometry] holds for both sides; ``med = { ... }`` and ``lat = { ... }`` replace single ones for a side.
"""

import itertools
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import CellGrid, dish
from casadi_contact.geometry.moving_surface import MovingSurface, swept_arcs
from casadi_contact.scenes.shapes.checks import fail, table_of
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape

SIDES = ("med", "lat")


class Knee(Shape):
    """Patches med (z > 0) and lat (z < 0); a patch's anchor is its condyle's centre."""

    name = "knee"
    parameters = (
        Parameter("sagittal_radii", "mm", high=180.0, count=None),
        Parameter("sagittal_junctions_deg", "deg", low=-60.0, high=180.0, count=None),
        Parameter("frontal_radius", "mm"),
        Parameter("condyle_offset", "mm"),
        Parameter("dish_sagittal_radius", "mm"),
        Parameter("dish_frontal_radius", "mm"),
        Parameter("plateau_length", "mm"),
        Parameter("plateau_width", "mm"),
    )

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of both sides and of each side, checked together."""
        known = {parameter.name: parameter for parameter in self.parameters}
        given = table_of("geometry", table, tuple(known), complete=True, optional=SIDES)
        checked: dict[str, Any] = {name: parameter.check(given[name]) for name, parameter in known.items()}
        for side in SIDES:
            if side in given:
                own = table_of(f"geometry.{side}", given[side], tuple(known), complete=False)
                checked[side] = {name: known[name].check(value) for name, value in own.items()}
            self._check_side(side, self.patch_geometry(checked, side))
        return checked

    @staticmethod
    def _check_side(side: str, g: Geometry) -> None:
        radii, junctions = g["sagittal_radii"], g["sagittal_junctions_deg"]
        if not radii:
            raise fail("geometry.sagittal_radii", radii, "at least one arc")
        if len(junctions) != len(radii) - 1 or any(a >= b for a, b in itertools.pairwise(junctions)):
            raise fail("geometry.sagittal_junctions_deg", junctions, f"{len(radii) - 1} rising angles between the arcs")
        # A condyle more curved than its dish has one contact region; half the patch must lie inside the dish's circle.
        limits = {
            "dish_frontal_radius": max(g["frontal_radius"], 0.5 * g["plateau_width"]),
            "dish_sagittal_radius": max(*radii, 0.5 * g["plateau_length"]),
        }
        for key, limit in limits.items():
            if g[key] <= limit:
                raise fail(f"geometry.{key} ({side})", g[key], f"more than {limit:g} (condyle and half patch)")

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return SIDES

    def patch_geometry(self, geometry: Geometry, patch: str) -> dict[str, Any]:
        common = {key: value for key, value in geometry.items() if key not in SIDES}
        return common | dict(geometry.get(patch, {}))

    def symmetric(self, geometry: Geometry) -> bool:
        medial, lateral = (self.patch_geometry(geometry, side) for side in SIDES)
        return medial == lateral

    def anchors(self, geometry: Geometry) -> Array:
        medial, lateral = (self.patch_geometry(geometry, side)["condyle_offset"] for side in SIDES)
        return np.array([[0.0, 0.0, medial], [0.0, 0.0, -lateral]])

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        surfaces = []
        for side, anchor in zip(SIDES, self.anchors(geometry), strict=True):
            g = self.patch_geometry(geometry, side)
            junctions = np.deg2rad(g["sagittal_junctions_deg"])
            surfaces.append(swept_arcs(g["sagittal_radii"], junctions, g["frontal_radius"], anchor[2]))
        return surfaces

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[CellGrid]:
        cells = []
        for side, anchor in zip(SIDES, self.anchors(geometry), strict=True):
            g = self.patch_geometry(geometry, side)
            extent = (g["plateau_length"], g["plateau_width"])
            centres, normals, areas = dish(grid, extent, g["dish_sagittal_radius"], g["dish_frontal_radius"])
            cells.append((centres + np.array([0.0, 0.0, anchor[2]]), normals, areas))
        return cells
