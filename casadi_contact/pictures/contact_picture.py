"""Pictures of contact: the pressure on the fixed surface, and sections of the moving one with elements near by."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.approach import trace_gap
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.pressures import PressureMap
from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses, evenly_spaced_indices, load_selection
from casadi_contact.core.quantities import quantity, three_digits
from casadi_contact.pictures.page import (
    CENTRE_OF_PRESSURE,
    PictureAxis,
    View,
    discs,
    name_axes,
    new_figure,
    patch_title,
    save_page,
    view_of,
)
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_mesh
from casadi_contact.scenes.shapes.shape import shape_named

MOST_FRAMES = 8
_DISC = 1.4  # diameter of an element's disc over its side: neighbours leave no gap


def draw_contact(model: ElasticFoundation, poses: Array, path: str | Path) -> None:
    """Write a picture of one pose, or a strip of up to MOST_FRAMES of several poses (n, 6), evenly spaced.
    Raises ValueError for no pose."""
    poses = as_poses(poses)
    if not len(poses):
        raise ValueError("there is no pose to draw, expected one or more")
    chosen = evenly_spaced_indices(len(poses), MOST_FRAMES)
    drawn = _one(model, poses[0]) if len(poses) == 1 else _strip(model, poses[chosen], chosen)
    save_page(drawn, path, bbox_inches="tight")


def _one(model: ElasticFoundation, pose: Array) -> Any:
    """Pressure, a section across all patches, and one along each."""
    maps, view = model.pressure_maps(pose), view_of(model)
    panels = 2 + len(maps)
    columns = panels if panels < 4 else (panels + 1) // 2
    rows = -(-panels // columns)
    figure = new_figure(4.6 * columns, 3.4 * rows + 0.6)
    seen, across, *others = figure.subplots(rows, columns, squeeze=False).ravel()
    draw_section(across, model, pose, maps, view)
    for axis, pressed in zip(others, maps, strict=False):
        draw_section(axis, model, pose, [pressed], View(view.up, view.right, view.toward))
    for axis in others[len(maps) :]:
        axis.set_axis_off()
    drawn = _draw_pressure(seen, maps, view, _largest([maps]))
    figure.colorbar(drawn, ax=seen, label="pressure [MPa]", shrink=0.8)
    seen.set_title(f"fixed surface, seen towards {view.name}", fontsize=9)
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(POSE_NAMES, pose, strict=True))
    said = f"{loads_text(model, pose, model.load_names)}\n{pressures_text(model, pose)}"
    figure.suptitle(f"{model.scene.name}: {at} [mm, rad]\n{said}", fontsize=9)
    return figure


def _strip(model: ElasticFoundation, poses: Array, numbers: np.ndarray) -> Any:
    frames, view = [model.pressure_maps(pose) for pose in poses], view_of(model)
    figure = new_figure(2.2 * len(frames) + 1.0, 2.6)
    axes = figure.subplots(1, len(frames), sharex=True, sharey=True)
    for place, (axis, maps, number) in enumerate(zip(axes, frames, numbers, strict=True)):
        drawn = _draw_pressure(axis, maps, view, _largest(frames))
        said = loads_text(model, poses[place], model.scene.sensitive_loads, between="\n")
        axis.set_title(f"frame {number}\n{said}", fontsize=8)
        axis.label_outer()
    figure.colorbar(drawn, ax=axes, label="pressure [MPa]", shrink=0.8)
    figure.suptitle(f"{model.scene.name}: fixed surface, seen towards {view.name}", fontsize=9)
    return figure


def loads_text(model: ElasticFoundation, pose: Array, names: Sequence[str], *, between: str = ", ") -> str:
    """Named loads of a pose (6,) in words: Fy_med -829 N, Tz 15221 N·mm."""
    loads = model.wrenches(pose[None])[0]
    values = np.einsum("lpk,pk->l", load_selection(names, model.patch_names), loads)
    return between.join(f"{n} {round(v) + 0:d} {quantity(n).unit}" for n, v in zip(names, values, strict=True))


def pressures_text(model: ElasticFoundation, pose: Array) -> str:
    """Area in contact, mean and peak pressure, penetration of each patch in a pose (6,), in words."""
    found = model.summary(pose[None])
    columns = (found.area_mm2[0], found.mean_mpa[0], found.largest_mpa[0], found.penetration_mm[0])
    said = [
        f"{area:.0f} mm², mean {mean:.3g} MPa, peak {peak:.3g} MPa, {depth:.2g} mm deep" if area else "no contact"
        for area, mean, peak, depth in zip(*columns, strict=True)
    ]
    names = [f"{name}: " if len(said) > 1 else "" for name in model.patch_names]
    return "; ".join(name + words for name, words in zip(names, said, strict=True))


def _largest(frames: Sequence[Sequence[PressureMap]]) -> float:
    return max((float(m.pressures_mpa.max(initial=0.0)) for maps in frames for m in maps), default=0.0) or 1.0


def _draw_pressure(axis: Any, maps: Sequence[PressureMap], view: View, largest: float) -> Any:
    """Every element in its colour (grey: no contact); a ring at each patch's centre of pressure."""
    for pressed in maps:
        width = _DISC * np.sqrt(pressed.areas_mm2)
        discs(axis, pressed.centres_mm, width, view, facecolors="0.88")
        loaded = pressed.pressures_mpa > 0.0
        colours = {"array": pressed.pressures_mpa[loaded], "clim": (0.0, largest)}
        drawn = discs(axis, pressed.centres_mm[loaded], width[loaded], view, **colours)
    for pressed in maps:
        if (centre := pressed.centre_mm) is not None:
            axis.plot(view.right.of(centre), view.up.of(centre), **CENTRE_OF_PRESSURE)
        if len(maps) > 1:  # its name above it
            up = view.up.of(pressed.centres_mm)
            place = (view.right.of(pressed.centres_mm).mean(), up.min() if view.up.reversed else up.max())
            look = {"textcoords": "offset points", "ha": "center", "va": "bottom", "fontsize": 8}
            axis.annotate(patch_title(pressed.patch), place, (0, 2), **look)
            axis.margins(y=0.15)
    name_axes(axis, view)
    return drawn


_OVERLAP_MM = 0.1
_FARTHEST_MM = 150.0


def contact_pose(model: ElasticFoundation) -> Array:
    """The scene's start pose (6,), moved along the direction of pressing until the bodies overlap by 0.1 mm. Raises
    ValueError where that never brings them together."""
    scene, back = model.scene, view_of(model).toward.pointing

    def pose_at(way_mm: Array) -> Array:
        travel_mm = (_FARTHEST_MM - way_mm)[:, None] * back
        return scene.pose_space.project(scene.start_pose + np.pad(travel_mm, ((0, 0), (0, 3))))

    def left_mm(_: np.ndarray, way_mm: Array) -> Array:
        return model.gaps(pose_at(way_mm)).min(axis=1) + _OVERLAP_MM

    way_mm, touching = trace_gap(left_mm, 1, reach_mm=2.0 * _FARTHEST_MM, touch_mm=1e-7)
    if not touching[0] or way_mm[0] == 0.0:
        raise ValueError(f"scene {scene.name} has no contact along the direction of pressing: give a pose")
    return pose_at(way_mm)[0]


_UM_PER_MM = 1000.0
_COLOURED_SHARE = 0.98  # of either body's vertices lie within the colour bar


def surface_fits(model: ElasticFoundation) -> list[str]:
    """A line for each body of the scene that is a mesh."""
    scene = model.scene
    return [f"{body}: {body_field(scene.geometry, body).fit}" for body in shape_named(scene.shape).mesh_bodies]


def draw_fit(model: ElasticFoundation, path: str | Path) -> None:
    """Write a picture of the vertices of each mesh in its body's frame, seen from where the other body lies and
    coloured by their signed distance from the smooth surface (above zero a vertex lies outside it)."""
    scene, view = model.scene, view_of(model)
    meshes = {body: body_mesh(scene.geometry, body) for body in shape_named(scene.shape).mesh_bodies}
    fields = {body: body_field(scene.geometry, body) for body in meshes}
    off_um = {body: _UM_PER_MM * fields[body](mesh.vertices_mm)[0] for body, mesh in meshes.items()}
    largest = max(float(np.quantile(np.abs(off), _COLOURED_SHARE)) for off in off_um.values()) or 1.0
    figure = new_figure(5.5 * len(meshes), 4.8)
    axes = figure.subplots(1, len(meshes), squeeze=False)[0]
    for axis, (body, mesh) in zip(axes, meshes.items(), strict=True):
        seen, colours = view.behind if body == "moving" else view, {"cmap": "RdBu_r", "clim": (-largest, largest)}
        order = np.argsort(mesh.vertices_mm @ seen.toward.pointing)  # far ones first: they are hidden
        reach = 1.5 * np.sqrt(np.median(mesh.areas_mm2))
        drawn = discs(axis, mesh.vertices_mm[order], reach, seen, array=off_um[body][order], **colours)
        name_axes(axis, seen)
        fit = fields[body].fit
        rms, most = _UM_PER_MM * fit.rms_mm, _UM_PER_MM * fit.largest_mm
        text = f"RMS {three_digits(rms)} µm, at most {three_digits(most)} µm"
        axis.set_title(f"{body} body, seen towards {seen.name}\n{text}", fontsize=9)
    figure.colorbar(drawn, ax=axes, label="signed distance [µm], outside > 0", shrink=0.8, extend="both")
    figure.suptitle(f"{scene.name}: how far the meshes' vertices lie from the smooth surfaces", fontsize=10)
    save_page(figure, path, bbox_inches="tight")


_POINTS = 300  # of the plane, each way
_MARGIN_MM = 4.0  # beyond the elements
_LEAST_HEIGHT = 0.45  # of the picture over the width of the widest patch: higher up a body may end
_GAP = 4.0  # element sides without an element: the line is broken there


def draw_section(axis: Any, model: ElasticFoundation, pose: Array, maps: Sequence[PressureMap], view: View) -> None:
    """Draw the plane normal to the view's up through the centre of pressure of these patches (the median of their
    elements out of contact), with its right to the right and `toward`, to where the moving body lies, upwards."""
    along, across, toward = view.right, view.up, view.toward
    centres, force = (np.concatenate(each) for each in zip(*((m.centres_mm, m.forces_n) for m in maps), strict=True))
    at = float(across.of(force @ centres / force.sum() if force.any() else np.median(centres, axis=0)))
    profiles = [_profile(pressed, at, along, across) for pressed in maps]
    low, high = _window(profiles, along, toward)
    for pressed, profile in zip(maps, profiles, strict=True):
        right, up = along.of(profile), toward.of(profile)
        # Each patch's own surface, where this patch lies: what two of them enclose between them is no contact.
        over = np.linspace(right.min() - _MARGIN_MM, right.max() + _MARGIN_MM, _POINTS)
        u, v = np.meshgrid(over, np.linspace(low[1], high[1], _POINTS))
        points = u[..., None] * along.direction + v[..., None] * toward.direction + at * across.direction
        distance = model.distances(points.reshape(-1, 3), pose, pressed.patch).reshape(u.shape)
        axis.contourf(u, v, distance, levels=[-1e3, 0.0], colors=["tab:blue"], alpha=0.25)
        axis.contour(u, v, distance, levels=[0.0], colors=["tab:blue"], linewidths=1.2)
        wide = np.hypot(np.diff(right), np.diff(up)) > _GAP * np.sqrt(np.median(pressed.areas_mm2))
        right, up = (np.insert(each, np.flatnonzero(wide) + 1, np.nan) for each in (right, up))
        axis.plot(right, up, color="tab:orange", linewidth=1.5)
        if (centre := pressed.centre_mm) is not None:
            axis.plot(along.of(centre), toward.of(centre), **CENTRE_OF_PRESSURE)
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=along.label, ylabel=toward.label)
    axis.xaxis.set_inverted(along.reversed)
    axis.yaxis.set_inverted(toward.reversed)
    patches = ", ".join(patch_title(pressed.patch) for pressed in maps)
    axis.set_title(f"{patches}: section at {across.name} = {round(at, 1) + 0.0:g} mm", fontsize=9)


def _profile(pressed: PressureMap, at: float, along: PictureAxis, across: PictureAxis) -> Array:
    """The elements (m, 3) within about half an element of the plane, in the order of `along`: the nearest to it of
    those that lie side by side, else the line jumps between their rows."""
    away, side = np.abs(across.of(pressed.centres_mm) - at), np.sqrt(np.median(pressed.areas_mm2))
    near = np.flatnonzero(away <= away.min() + 0.5 * side)
    place = along.of(pressed.centres_mm[near])
    step = np.floor((place - place.min()) / side + 0.5)
    nearest_first = np.lexsort((away[near], step))
    kept = nearest_first[np.unique(step[nearest_first], return_index=True)[1]]
    return pressed.centres_mm[near[kept]]


def _window(profiles: Sequence[Array], along: PictureAxis, toward: PictureAxis) -> tuple[Array, Array]:
    """Lowest and highest coordinates (2,) along `along` and `toward`, with room for the moving body."""
    every = np.concatenate(profiles)
    coordinates = np.stack([along.of(every), toward.of(every)], axis=1)
    low, high = coordinates.min(axis=0) - _MARGIN_MM, coordinates.max(axis=0) + _MARGIN_MM
    widest = max(float(np.ptp(along.of(profile))) for profile in profiles) + 2.0 * _MARGIN_MM
    height = max(high[1] - low[1], _LEAST_HEIGHT * widest)
    if toward.reversed:
        low[1] = high[1] - height
    else:
        high[1] = low[1] + height
    return low, high
