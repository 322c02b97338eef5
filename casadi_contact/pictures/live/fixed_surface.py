"""The fixed surface of each patch as the page draws it: triangles, and where its C finds the pressure at each point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from casadi_contact.contact.cells.basis import Cells, hermite_products
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.patches import CellPatch, lay_cells, patch_charts
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.cup.quadrature import Cup
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.ray_hits import fixed_point
from casadi_contact.contact.polar.surfaces import SmoothPatch, u_range
from casadi_contact.core.conventions import Array
from casadi_contact.pictures.live.triangles import Triangles

_SIDE_MM = 0.7  # about, between points
_MOST_ALONG = 91  # of these, each way of a smooth surface
_COARSE = 2  # of which every so many-th row is enough for the bodies in 3-D
_SAME_DIGITS = 6  # of coordinates [mm]


@dataclass(frozen=True, eq=False)
class FixedSurface:
    """One patch: triangles, larger ones between some of the same points for the bodies in 3-D, and places (m, q) of the
    points, which its model's ``foundation_pressures`` reads (``contact/c/*_depths.h``)."""

    triangles: Triangles
    coarse: Triangles
    places: Array

    @classmethod
    def of_grid(cls, points_mm: Array, normals: Array, places: Array) -> FixedSurface:
        """Of points (n, m, 3) in a grid and places (n, m, q)."""
        fine, coarse = (Triangles.of_grid(points_mm, normals, every) for every in (1, _COARSE))
        return cls(fine, coarse, places.reshape(-1, places.shape[-1]))


@singledispatch
def fixed_surfaces(model: CompiledFoundation) -> list[FixedSurface]:
    """The fixed surface of each patch of a contact model; raises TypeError for a model without."""
    raise TypeError(f"{model!r} has no surface to draw, expected a model made by cc.foundation")


@fixed_surfaces.register
def _(model: PolarFoundation) -> list[FixedSurface]:
    return [_chart_surface(patch) for patch in model.patches]


@fixed_surfaces.register
def _(model: CupFoundation) -> list[FixedSurface]:
    return [_cup_surface(model.cup)]


@fixed_surfaces.register
def _(model: CellFoundation) -> list[FixedSurface]:
    charts = patch_charts(model.scene)
    return [_cell_surface(lay_cells(chart, model.cells, cut=1), model.cells) for chart in charts]


def _chart_surface(patch: SmoothPatch) -> FixedSurface:
    """Over the chart; places are (u, v)."""
    v = np.linspace(*patch.rim.v, _count(patch.rim.v[1] - patch.rim.v[0]))
    start, end = u_range(patch, v)
    u = start + np.linspace(0.0, 1.0, _count(float((end - start).max())))[:, None] * (end - start)
    places = np.stack([u, np.broadcast_to(v, u.shape)], -1)
    c, N, _ = fixed_point(patch, places[..., 0], places[..., 1])
    normals = N / np.linalg.norm(N, axis=-1, keepdims=True)
    return FixedSurface.of_grid(c @ patch.turn, normals @ patch.turn, places)


def _cup_surface(cup: Cup) -> FixedSurface:
    """Circles about the pole; places are directions from the cup's centre."""
    angle = np.linspace(0.0, cup.half_angle, _count(cup.radius * cup.half_angle))
    turn = np.linspace(0.0, 2.0 * np.pi, 4 * len(angle) + 1)
    first = np.cross(np.eye(3)[np.abs(cup.pole).argmin()], cup.pole)
    first /= np.linalg.norm(first)
    second = np.cross(cup.pole, first)
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    e = np.cos(angle)[:, None, None] * cup.pole + np.sin(angle)[:, None, None] * around
    return FixedSurface.of_grid(cup.centre + cup.radius * e, -e, e)


def _cell_surface(patch: CellPatch, cells: Cells) -> FixedSurface:
    """The cells that are whole at least by half, each cut into smaller ones; places are points with their normals."""
    corners = patch.corners[patch.present.mean(axis=1) > 0.5]
    cut = [max(1, round(size / _SIDE_MM)) for size in (cells.u_mm, cells.v_mm)]
    xi, eta = (np.linspace(0.0, 1.0, count + 1) for count in cut)
    values = np.concatenate([patch.c[:, None], patch.tangents], 1)[corners].reshape(len(corners), 12, 3)
    points = np.einsum("jr,kji->kri", hermite_products(xi, eta), values)
    shares = np.stack([np.outer(x, y).ravel() for x in (1.0 - xi, xi) for y in (1.0 - eta, eta)])
    normals = np.einsum("cr,kci->kri", shares, patch.n[corners])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rounded = np.round(points.reshape(-1, 3), _SAME_DIGITS)  # neighbouring cells share the points of their sides
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(len(corners), len(xi), len(eta))
    # Few digits of places compress well, and drawn points are no more exact.
    c, n = (array.reshape(-1, 3)[first].astype(np.float32).astype(float) for array in (points, normals))
    fine, coarse = (Triangles.of_quads(c, n, _quads(of)) for of in (number, number[:, :: cut[0], :: cut[1]]))
    return FixedSurface(fine, coarse, np.concatenate([c, n], 1))


def _quads(number: np.ndarray) -> np.ndarray:
    """Corners (k, 4) of the faces between points numbered (cells, n, m)."""
    return np.stack([number[:, :-1, :-1], number[:, 1:, :-1], number[:, 1:, 1:], number[:, :-1, 1:]], -1).reshape(-1, 4)


def _count(length_mm: float) -> int:
    return int(np.clip(round(length_mm / _SIDE_MM), 8, _MOST_ALONG - 1)) + 1
