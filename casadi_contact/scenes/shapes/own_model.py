"""The shape of a scene without geometry: its contact model is the user's own, or a table of samples.

    shape = "own_model"
    [geometry.patches]     each with its anchor on the moving body [mm], the body's origin if left out
    contact = { anchor = [0.0, 0.0, 0.0] }

Such a scene needs neither [material] nor [grids].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.shapes.checks import fail, identifier, numbers, table_of
from casadi_contact.scenes.shapes.shape import Geometry, Shape


class OwnModel(Shape):
    """Patches and their anchors, nothing more."""

    name = "own_model"
    has_layer = False

    def check(self, table: object) -> dict[str, Any]:
        values = table_of("geometry", table, ("patches",), complete=True)
        patches = values["patches"]
        if not isinstance(patches, Mapping) or not patches:
            raise fail(
                "geometry.patches", patches, "a table for each patch, e.g. contact = { anchor = [0.0, 0.0, 0.0] }"
            )
        for name, patch in patches.items():
            identifier("geometry.patches (a patch's name)", name)
            if "_" in name:
                raise fail("geometry.patches (a patch's name)", name, "a name without _, which sets it off in Fy_med")
            key = f"geometry.patches.{name}"
            given = table_of(key, patch, (), complete=False, optional=("anchor",))
            numbers(f"{key}.anchor", given.get("anchor", [0.0] * 3), 3, "mm")
        return values

    def patches(self, geometry: Geometry) -> tuple[str, ...]:
        return tuple(geometry["patches"])

    def anchors(self, geometry: Geometry) -> Array:
        return patch_anchors(geometry)

    def surfaces(self, geometry: Geometry) -> NoReturn:
        raise ValueError("a scene of the shape own_model has no surfaces: give your own contact model")

    def cells(self, geometry: Geometry, grid: tuple[int, int]) -> NoReturn:
        self.surfaces(geometry)


def patch_anchors(geometry: Geometry) -> Array:
    """The anchors (patches, 3) [mm] that [geometry.patches] names, the moving body's origin if left out."""
    return np.array([patch.get("anchor", [0.0, 0.0, 0.0]) for patch in geometry["patches"].values()], dtype=float)
