"""How well the smooth surfaces of a mesh scene fit its meshes, as text and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import three_digits
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.pictures.figure import discs, name_axes, new_figure, save
from casadi_contact.pictures.view import View, view_of
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_mesh
from casadi_contact.scenes.shapes.shape import shape_named

_UM_PER_MM = 1000.0
_COLOURED_SHARE = 0.98  # of either body's vertices lie within the colour bar


def surface_fits(model: ElasticFoundation) -> list[str]:
    """A line for each body of the scene that is a mesh."""
    scene = model.scene
    return [f"{body}: {body_field(scene.geometry, body).fit}" for body in shape_named(scene.shape).mesh_bodies]


def draw_fit(model: ElasticFoundation, path: str | Path) -> None:
    """Write a picture of both meshes' vertices in their bodies' frames, each seen from where the other body lies and
    coloured by its signed distance from the smooth surface (above zero the vertex lies outside it).

    Raises ValueError for a scene that is not made of meshes.
    """
    scene, view = model.scene, view_of(model)
    meshes = {body: body_mesh(scene.geometry, body) for body in ("moving", "fixed")}
    fields = {body: body_field(scene.geometry, body) for body in meshes}
    off_um = {body: _UM_PER_MM * fields[body](mesh.vertices_mm)[0] for body, mesh in meshes.items()}
    largest = max(float(np.quantile(np.abs(off), _COLOURED_SHARE)) for off in off_um.values()) or 1.0
    figure = new_figure(11.0, 4.8)
    axes = figure.subplots(1, 2)
    for axis, body, seen in zip(axes, meshes, (view.behind, view), strict=True):
        drawn = _vertices(axis, meshes[body], off_um[body], seen, largest)
        fit = fields[body].fit
        rms, most = _UM_PER_MM * fit.rms_mm, _UM_PER_MM * fit.largest_mm
        text = f"RMS {three_digits(rms)} µm, at most {three_digits(most)} µm"
        axis.set_title(f"{body} body, seen towards {seen.name}\n{text}", fontsize=9)
    figure.colorbar(drawn, ax=axes, label="signed distance [µm], outside > 0", shrink=0.8, extend="both")
    figure.suptitle(f"{scene.name}: how far the meshes' vertices lie from the smooth surfaces", fontsize=10)
    save(figure, path)


def _vertices(axis: Any, mesh: TriangleMesh, off_um: Array, view: View, largest: float) -> Any:
    """The vertices in their colours, far ones first: what lies behind is hidden by what lies before it."""
    order = np.argsort(mesh.vertices_mm @ view.toward.pointing)
    reach = 1.5 * np.sqrt(np.median(mesh.areas_mm2))
    drawn = discs(
        axis, mesh.vertices_mm[order], reach, view, array=off_um[order], cmap="RdBu_r", clim=(-largest, largest)
    )
    name_axes(axis, view)
    return drawn
