"""A sphere in a spherical dish, to verify contact models on: forces pass through the dish's centre."""

from __future__ import annotations

import math
from typing import Any

from casadi_contact.geometry.elements import Cells, dish
from casadi_contact.geometry.moving_surface import MovingSurface, sphere
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import Geometry, Parameter, Shape


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
        """The sphere."""
        return [sphere(geometry["radius"])]

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> list[Cells]:
        """The dish."""
        radius, side = geometry["dish_radius"], geometry["patch_side"]
        return [dish(grid, (side, side), radius, radius)]
