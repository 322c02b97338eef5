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

_LEAST_AREA = 1e-12  # of a triangle [mm²]
_FLAT = 0.7  # size of the mean normal above which a layer goes down in one direction: not so for a cup


@dataclass(frozen=True, eq=False)
class Triangles:
    """points_mm (m, 3), their unit normals outwards (m, 3), and corners (k, 3) anticlockwise seen from outside."""

    points_mm: Array
    normals: Array
    corners: np.ndarray

    @classmethod
    def of_grid(cls, points_mm: Array, normals: Array, every: int = 1) -> Triangles:
        """Of points (n, m, 3) in a grid with normals that say which side is outside; corners are in every so many-th
        row and column, and in the last."""
        n, m = points_mm.shape[:2]
        rows, columns = (np.unique([*range(0, count, every), count - 1]) for count in (n, m))
        at = np.arange(n * m).reshape(n, m)[np.ix_(rows, columns)]
        quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], -1).reshape(-1, 4)
        return cls.of_quads(points_mm.reshape(-1, 3), normals.reshape(-1, 3), quads)

    @classmethod
    def of_quads(cls, points_mm: Array, normals: Array, quads: np.ndarray) -> Triangles:
        """Of four-sided faces (k, 4), their corners in order around."""
        corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        a, b, c = np.moveaxis(points_mm[corners], 1, 0)
        across = np.cross(b - a, c - a)
        inward = np.einsum("ij,ij->i", across, normals[corners[:, 0]]) < 0.0
        corners[inward] = corners[inward][:, ::-1]
        return cls(points_mm, normals, corners[np.einsum("ij,ij->i", across, across) > _LEAST_AREA**2])

    @classmethod
    def together(cls, parts: list[Triangles]) -> Triangles:
        """Several as one."""
        starts = np.cumsum([0, *(len(part.points_mm) for part in parts)])
        corners = [part.corners + start for part, start in zip(parts, starts, strict=False)]
        points, normals = [part.points_mm for part in parts], [part.normals for part in parts]
        return cls(np.concatenate(points), np.concatenate(normals), np.concatenate(corners))

    @property
    def rim(self) -> np.ndarray:
        """Edges (e, 2) that belong to one triangle alone."""
        edges = np.concatenate([self.corners[:, [0, 1]], self.corners[:, [1, 2]], self.corners[:, [2, 0]]])
        _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        return edges[first[count == 1]]

    def behind(self, thickness_mm: float) -> Triangles:
        """The other side of a layer below the surface, with a wall from rim to rim: together they look like a body."""
        mean = self.normals.mean(axis=0)
        size = float(np.linalg.norm(mean))
        into = -mean / size if size > _FLAT else -self.normals
        below = self.points_mm + thickness_mm * into
        used, corners = np.unique(self.corners[:, ::-1], return_inverse=True)
        underside = Triangles(below[used], -self.normals[used], corners.reshape(-1, 3))
        first, second = self.rim.T
        points = np.stack([self.points_mm[first], self.points_mm[second], below[second], below[first]], 1)
        outward = np.cross(points[:, 1] - points[:, 0], self.normals[first])
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
        quads = np.arange(4 * len(points)).reshape(-1, 4)
        wall = Triangles.of_quads(points.reshape(-1, 3), np.repeat(outward, 4, axis=0), quads)
        return Triangles.together([underside, wall])


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
