"""The contact model of a page: that of the scene, and for meshes one whose tables fit into a page."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.source import cell_source
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.scenes.scene import Scene

FARTHEST_MM = 3.0  # at which the distance from a mesh ends: what lies farther off is as far
_NEAR_MM = 1.5  # of the surface: here the field counts for loads, farther off for gaps
_NEAR_STEP_MM, _FAR_STEP_MM = 2.0**-12, 2.0**-3  # that coefficients are rounded to, so that they compress
_CELLS = Cells(2.4, 0.85)


class PageCells(CellFoundation):
    """Cubic cells of meshes, the distance field rounded to about 0.1 µm near the surface, none beyond `FARTHEST_MM`."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, _CELLS)
        self.patches = [
            replace(patch, body=MovingSurface(MESH_FIELD, _rounded(patch.body.parameters))) for patch in self.patches
        ]

    @cached_property
    def _code(self) -> tuple[str, bytes]:
        return cell_source(self.patches, with_tangents=False)


def page_contact(scene: Scene) -> CompiledFoundation:
    """`foundation` of a scene, or for meshes `PageCells`: the page's numbers are those of this model.

    Raises ValueError for a shape that has none.
    """
    return PageCells(scene) if scene.shape == "mesh" else foundation(scene)


def _rounded(parameters: Array) -> Array:
    """A field's parameters with few digits: all that are needed near the surface, and hardly any elsewhere."""
    _, _, coefficients, bounds = field_parts(parameters)
    step = np.where(np.abs(coefficients) < _NEAR_MM, _NEAR_STEP_MM, _FAR_STEP_MM)
    rounded = np.clip(np.round(coefficients / step) * step, -FARTHEST_MM, FARTHEST_MM)
    head = parameters[: len(parameters) - 2 * coefficients.size]
    return np.concatenate([head, rounded.ravel(), bounds.ravel()])
