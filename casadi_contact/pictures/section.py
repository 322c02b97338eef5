"""A plane through the bodies: the moving body's surface, and the fixed body's elements near the plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.pressures import PressureMap
from casadi_contact.core.conventions import Array
from casadi_contact.pictures.page import CENTRE_OF_PRESSURE, new_figure, patch_title
from casadi_contact.pictures.view import PictureAxis, View

_POINTS = 300  # of the plane, each way
_MARGIN_MM = 6.0  # beyond the elements
_LEAST_HEIGHT = 0.45  # of the picture over the width of the widest patch: higher up a body may end
_SHARE_OF_WAY = 0.3  # between neighbouring patches
_GAP = 4.0  # element sides without an element: the line is broken there


def page_of_sections(model: ElasticFoundation, pose: Array, maps: Sequence[PressureMap], view: View) -> tuple[Any, Any]:
    """A figure with the section across all patches and one along each, and its first panel, which is empty."""
    panels = 2 + len(maps)
    columns = panels if panels < 4 else (panels + 1) // 2
    rows = -(-panels // columns)
    figure = new_figure(4.6 * columns, 3.4 * rows + 0.6)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    draw_section(axes[1], model, pose, maps, along=view.right, across=view.up, toward=view.toward)
    for axis, pressed in zip(axes[2:], maps, strict=False):
        draw_section(axis, model, pose, [pressed], along=view.up, across=view.right, toward=view.toward)
    for axis in axes[panels:]:
        axis.set_axis_off()
    return figure, axes[0]


def draw_section(
    axis: Any,
    model: ElasticFoundation,
    pose: Array,
    maps: Sequence[PressureMap],
    *,
    along: PictureAxis,
    across: PictureAxis,
    toward: PictureAxis,
) -> None:
    """Draw the plane normal to `across` through the centre of pressure of these patches (their middle out of contact),
    with `along` to the right and `toward`, to where the moving body lies, upwards."""
    at = float(across.of(_centre(maps)))
    profiles = [_profile(pressed, at, along, across) for pressed in maps]
    low, high = _window(profiles, along, toward)
    reaches = _reaches([along.of(profile) for profile in profiles], low[0], high[0])
    for pressed, profile, reach in zip(maps, profiles, reaches, strict=True):
        # Each patch's own surface, where this patch lies: what two of them enclose between them is no contact.
        u, v = np.meshgrid(np.linspace(*reach, _POINTS), np.linspace(low[1], high[1], _POINTS))
        points = u[..., None] * along.direction + v[..., None] * toward.direction + at * across.direction
        distance = model.distances(points.reshape(-1, 3), pose, pressed.patch).reshape(u.shape)
        axis.contourf(u, v, distance, levels=[-1e3, 0.0], colors=["tab:blue"], alpha=0.25)
        axis.contour(u, v, distance, levels=[0.0], colors=["tab:blue"], linewidths=1.2)
        right, up = along.of(profile), toward.of(profile)
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


def _centre(maps: Sequence[PressureMap]) -> Array:
    """Centre of pressure (3,) of all these patches together, the median of their elements out of contact."""
    centres = np.concatenate([pressed.centres_mm for pressed in maps])
    force = np.concatenate([pressed.forces_n for pressed in maps])
    return force @ centres / force.sum() if force.any() else np.median(centres, axis=0)


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


def _reaches(coordinates: Sequence[Array], low: float, high: float) -> list[tuple[float, float]]:
    """How far to both sides each profile's moving surface is drawn: a share of the way to the next one, or to the
    ends low and high."""
    ends = [(float(c.min()), float(c.max())) for c in coordinates]
    found = []
    for first, last in ends:
        before, behind = [b for _, b in ends if b < first], [a for a, _ in ends if a > last]
        left = first - _SHARE_OF_WAY * (first - max(before)) if before else low
        right = last + _SHARE_OF_WAY * (min(behind) - last) if behind else high
        found.append((left, right))
    return found


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
