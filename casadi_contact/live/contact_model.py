"""The contact model of a page: that of the scene, and for meshes one whose tables fit into a page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.contact import CellFoundation, foundation
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.compiled import CompiledFoundation
from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import build_field, field_parts
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.scenes import Scene

_SPACING_MM = 1.2  # of a page's distance field: the library's own takes 15 MB for a knee
_NEAR_MM = 3.0  # of the surface: here the field counts for loads, farther off for gaps
_NEAR_STEP_MM, _FAR_STEP_MM = 2.0**-16, 2.0**-5  # that coefficients are rounded to, so that they compress
_CELLS = Cells(2.4, 0.85)


def page_contact(scene: Scene) -> CompiledFoundation:
    """`foundation` of a scene, or for meshes `CellFoundation` on a coarser distance field.

    It is a model like any other: the page's numbers are its own. Raises ValueError for a shape that has none.
    """
    if scene.shape != "mesh":
        return foundation(scene)
    from casadi_contact.shapes.mesh_bodies import body_mesh

    field = build_field(body_mesh(scene.geometry, "moving"), max(_SPACING_MM, float(scene.geometry["spacing"])))
    body = MovingSurface(MESH_FIELD, _rounded(field.parameters))
    model = CellFoundation(scene, _CELLS)
    model.patches = [replace(patch, body=body) for patch in model.patches]
    return model


def _rounded(parameters: Array) -> Array:
    """A field's parameters with few digits: all that are needed near the surface, and hardly any elsewhere."""
    _, _, coefficients, bounds = field_parts(parameters)
    near = np.abs(coefficients) < _NEAR_MM
    step = np.where(near, _NEAR_STEP_MM, _FAR_STEP_MM)
    head = parameters[: len(parameters) - 2 * coefficients.size]
    return np.concatenate([head, (np.round(coefficients / step) * step).ravel(), bounds.ravel()])
