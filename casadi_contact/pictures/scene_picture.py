"""A picture of how a scene is understood: its patches, where contact travels over them, and a pose at rest; how well
smooth surfaces fit their meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.core.quantities import three_digits
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.pictures.contact_picture import loads_text
from casadi_contact.pictures.page import discs, name_axes, new_figure, patch_title, save
from casadi_contact.pictures.section import page_of_sections
from casadi_contact.pictures.view import View, view_of
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_mesh
from casadi_contact.scenes.shapes.shape import shape_named

_COLOURS = (("tab:orange", "#fde3cb"), ("tab:green", "#d3ecd3"), ("tab:purple", "#e6dcf2"), ("tab:brown", "#e5d8d5"))
_DISC = 2.0  # diameter of an element's disc over its side: cells twice as long as wide leave no gap
_MOST_CENTRES = 120


def draw_scene(model: ElasticFoundation, pose: Array, poses: Array, path: str | Path) -> None:
    """Write a picture: the fixed surface by patch with the centres of pressure of poses (n, 6), seen as the moving body
    presses, and the pose (6,) in section across all patches and along each."""
    pose, poses = as_poses([pose])[0], as_poses(poses)
    maps, view = model.pressure_maps(pose), view_of(model)
    figure, seen = page_of_sections(model, pose, maps, view)
    _draw_patches(seen, model, poses, view)
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(POSE_NAMES, pose, strict=True))
    said = loads_text(model, pose, model.scene.sensitive_loads)
    figure.suptitle(f"{model.scene.name}: at rest at {at} [mm, rad], {said}", fontsize=9)
    save(figure, path)


def _draw_patches(axis: Any, model: ElasticFoundation, poses: Array, view: View) -> None:
    chosen = poses[:: max(1, len(poses) // _MOST_CENTRES)]
    travelled = [model.pressure_maps(pose) for pose in chosen]
    for number, elements in enumerate(model.scene.elements(model.grid)):
        (colour, pale), name = _COLOURS[number % len(_COLOURS)], patch_title(model.patch_names[number])
        discs(axis, elements.centres_mm, _DISC * np.sqrt(elements.areas_mm2), view, facecolors=pale)
        centres = [maps[number].centre_mm for maps in travelled]
        found = np.array([centre for centre in centres if centre is not None]).reshape(-1, 3)
        axis.plot(view.right.of(found), view.up.of(found), ".", color=colour, markersize=4, label=name)
        edge = elements.edge_centres_mm
        axis.plot(view.right.of(edge), view.up.of(edge), ".", color="0.4", markersize=1)
    origin = np.zeros((1, 3))
    axis.plot(view.right.of(origin), view.up.of(origin), "k+", markersize=8, label="origin")
    axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0)
    axis.set_title(f"patches and centres of pressure,\nseen towards {view.name}; grey: cut edges", fontsize=9)
    name_axes(axis, view)


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
