"""Bodies of closed-form contact on an elastic plane y = 0 or in a dish, to verify contact models."""

from __future__ import annotations

import math
from typing import Any

from casadi_contact.geometry.elements import Cells, dish, plane
from casadi_contact.geometry.moving_surface import MovingSurface, cylinder, half_space, sphere
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape


class SphereOnPlane(Shape):
    """A sphere about the moving origin on a square of elements."""

    name = "sphere_on_plane"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("patch_side", "mm"))

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [sphere(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        return [plane(grid, (geometry["patch_side"], geometry["patch_side"]))]


class CylinderOnPlane(Shape):
    """A cylinder about the moving z axis on a strip, patch_side along x and length along z."""

    name = "cylinder_on_plane"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("length", "mm"), Parameter("patch_side", "mm"))

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [cylinder(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        return [plane(grid, (geometry["patch_side"], geometry["length"]))]


class PunchOnPlane(Shape):
    """A flat punch, the moving half-space y >= 0, on a square of the given area."""

    name = "punch_on_plane"
    anatomical = False
    parameters = (Parameter("area", "mm²"),)

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [half_space()]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        side = geometry["area"] ** 0.5
        return [plane(grid, (side, side))]


class SphereInDish(Shape):
    """A sphere about the moving origin in a dish, lowest at the fixed origin, over a square of elements."""

    name = "sphere_in_dish"
    anatomical = False
    parameters = (Parameter("radius", "mm"), Parameter("dish_radius", "mm"), Parameter("patch_side", "mm"))

    def check(self, table: object) -> dict[str, Any]:
        """The numbers of a sphere and a patch that lie inside the dish."""
        values = super().check(table)
        limit = max(values["radius"], values["patch_side"] / math.sqrt(2.0))
        if values["dish_radius"] <= limit:
            raise fail("geometry.dish_radius", values["dish_radius"], f"more than {limit:g} (sphere, half patch)")
        return values

    def surfaces(self, geometry: Geometry) -> list[MovingSurface]:
        return [sphere(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        radius, side = geometry["dish_radius"], geometry["patch_side"]
        return [dish(grid, (side, side), radius, radius)]
