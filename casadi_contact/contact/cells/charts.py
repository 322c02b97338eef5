"""Charts of fixed surfaces: points, normals and their derivatives over coordinates (u, v) [mm].

A surface lies at the height h(u, v) along the lines of a projection (`geometry.projection`). A mesh is seen from where
the moving body comes: from above, u = x and v = z, along the scene's `pressing`, or from a cup's middle. It is the zero
of its distance field on each line. Beyond its edge, where the cells of the rim still need corners, it goes on as the
quadric h(u, v) through the points around, and so it does where the mesh turns over a sharp edge at its rim, which
cubics cannot follow. A spherical cup is seen from its centre; a plane is its own chart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from casadi_contact.conventions import Array
from casadi_contact.geometry.field_derivatives import field_derivatives
from casadi_contact.geometry.mesh_elements import grid_on_mesh
from casadi_contact.geometry.projection import (
    DOWN,
    LEAST_UPWARD,
    CentralProjection,
    Lines,
    ParallelProjection,
    grid_frame,
)
from casadi_contact.scenes import Scene

CELL_SHAPES = ("mesh", "ball_in_cup", "sphere_on_plane", "cylinder_on_plane", "punch_on_plane")
_STEPS = 6  # of Newton's method along the rays
_SHARPEST = 1.0  # curvature [1/mm] of an edge, convex: normals turn by a radian within a cell
_AROUND_MM = 2.5  # reach of the quadric that continues a surface
_FEWEST = 12  # points that it goes through


@dataclass(frozen=True)
class Surface:
    """Of m points: c (m, 3), unit normal n outwards (m, 3) and their derivatives by u and v (m, 2, 3); known (m,) is
    False where the surface was continued beyond its rim."""

    c: Array
    n: Array
    tangents: Array
    bends: Array
    known: np.ndarray


class Chart(Protocol):
    """The fixed surface of one patch over (u, v)."""

    low: Array
    high: Array

    def present(self, u: Array, v: Array) -> np.ndarray:
        """True (nu, nv) where the surface has a point: u (nu,) and v (nv,) are the middles of equal parts."""

    def surface(self, u: Array, v: Array) -> Surface:
        """The surface at points (m,), (m,), after `present` was asked."""


def patch_charts(scene: Scene) -> list[Chart]:
    """The charts of a scene's patches; raises ValueError for a shape that has none."""
    if scene.shape == "mesh":
        return [MeshChart(scene, patch) for patch in scene.patch_names]
    if scene.shape == "ball_in_cup":
        return [CupChart(scene)]
    g = scene.geometry
    if scene.shape == "punch_on_plane":
        return [PlaneChart(g["area"] ** 0.5, g["area"] ** 0.5)]
    if scene.shape in CELL_SHAPES:
        return [PlaneChart(g["patch_side"], g.get("length", g["patch_side"]))]
    raise ValueError(
        f"scene {scene.name} has the shape {scene.shape}, which cubic cells do not cover: expected one of "
        f"{', '.join(CELL_SHAPES)}; others take cc.ElasticFoundation"
    )


class PlaneChart:
    """The rectangle y = 0 about the origin."""

    def __init__(self, length: float, width: float) -> None:
        self.high = 0.5 * np.array([length, width])
        self.low = -self.high

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Everywhere."""
        return np.ones((len(u), len(v)), dtype=bool)

    def surface(self, u: Array, v: Array) -> Surface:
        """Flat."""
        lines = ParallelProjection(grid_frame(DOWN)).lines(u, v)
        return _surface_at(lines, np.zeros((len(u), 6)), np.ones(len(u), dtype=bool))


class CupChart:
    """The inside of a spherical cap."""

    def __init__(self, scene: Scene) -> None:
        g = scene.geometry
        radius, pole = float(g["cup_radius"]), np.asarray(g["cup_pole"], dtype=float)
        pole /= np.linalg.norm(pole)
        first = np.cross(np.eye(3)[np.abs(pole).argmin()], pole)
        first /= np.linalg.norm(first)
        frame = np.array([first, -pole, np.cross(pole, first)])
        self._projection = CentralProjection(frame, np.asarray(g["cup_centre"], dtype=float), radius)
        self.rim = 2.0 * radius * np.sin(0.5 * np.deg2rad(g["cup_half_angle_deg"]))
        self.low, self.high = np.full(2, -self.rim), np.full(2, self.rim)

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Within the rim's circle."""
        return np.asarray(u[:, None] ** 2 + v[None, :] ** 2 <= self.rim**2)

    def surface(self, u: Array, v: Array) -> Surface:
        """At the radius everywhere."""
        jet = np.zeros((len(u), 6))
        jet[:, 0] = -self._projection.radius_mm
        return _surface_at(self._projection.lines(u, v), jet, u**2 + v**2 <= self.rim**2)


class MeshChart:
    """The part of a fixed mesh that a patch's box holds, as its scene's projection shows it."""

    def __init__(self, scene: Scene, patch: str) -> None:
        from casadi_contact.shapes.mesh_bodies import body_field, body_surface, patch_box
        from casadi_contact.shapes.mesh_patches import patch_mesh, patch_projection

        self._projection = patch_projection(scene.geometry, patch)
        self._mesh = patch_mesh(scene.geometry, patch, reaching=True)
        self._field = body_field(scene.geometry, "fixed")
        self._surface = partial(body_surface, scene.geometry, "fixed")
        self._box = patch_box(scene.geometry, patch)
        self.low, self.high, _ = self._projection.bounds(self._mesh, self._box)

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Where a ray meets the mesh inside the box, and no wall."""
        grid = (len(u), len(v))
        points, _, areas = grid_on_mesh(self._mesh, self._field, grid, self._box, self._projection, self._surface)
        present = areas > 0.0
        lines = self._projection.lines(*(values.ravel() for values in np.meshgrid(u, v, indexing="ij")))
        heights = np.einsum("nk,nk->n", points.reshape(-1, 3) - lines.starts, lines.ups)
        self._heights = heights.reshape(areas.shape)
        edge = present & self._sharp(points.reshape(-1, 3)).reshape(areas.shape)
        ends = ~ndimage.binary_erosion(present, np.ones((3, 3)))
        self._smooth = present & ~ndimage.binary_propagation(edge & ends, np.ones((3, 3)), edge)
        self._origin, self._step = np.array([u[0], v[0]]), np.array([u[1] - u[0], v[1] - v[0]])
        return present

    def surface(self, u: Array, v: Array) -> Surface:
        """From the distance field where the four points of `present` around are on the mesh and not on its rim's edge,
        continued elsewhere."""
        place = (np.stack([u, v], 1) - self._origin) / self._step
        first = np.clip(np.floor(place).astype(int), 0, np.array(self._smooth.shape) - 2)
        corners = [(first[:, 0] + a, first[:, 1] + b) for a in (0, 1) for b in (0, 1)]
        known = np.all([self._smooth[corner] for corner in corners], axis=0)
        height = np.mean([self._heights[corner] for corner in corners], axis=0)
        jet = np.zeros((len(u), 6))
        jet[known], found = self._jets(self._projection.lines(u[known], v[known]), height[known])
        known[np.flatnonzero(known)[~found]] = False
        if not known.all():
            jet[~known] = self._continued(u[~known], v[~known])
        return _surface_at(self._projection.lines(u, v), jet, known)

    def _jets(self, lines: Lines, h: Array) -> tuple[Array, np.ndarray]:
        """h and its derivatives u, v, uu, uv, vv (m, 6) on the field's zero; False for a wall (m,)."""
        up, h = lines.ups, h.copy()
        for _ in range(_STEPS):
            g, slope = self._field(lines.starts + h[:, None] * up)
            h -= g / np.maximum(np.einsum("nk,nk->n", slope, up), LEAST_UPWARD)
        _, slope, bend = field_derivatives(self._field.parameters, lines.starts + h[:, None] * up)
        along = np.einsum("nk,nk->n", slope, up)
        fine = along > LEAST_UPWARD * np.linalg.norm(slope, axis=1)
        along = np.where(fine, along, 1.0)
        across = lines.start_slopes + h[:, None, None] * lines.up_slopes
        h_a = -np.einsum("nk,nak->na", slope, across) / along[:, None]
        c_a = across + h_a[..., None] * up[:, None]
        turns = h_a[:, :, None, None] * lines.up_slopes[:, None]
        rest = turns + np.swapaxes(turns, 1, 2) + h[:, None, None, None] * lines.up_bends
        h_ab = -np.einsum("nai,nij,nbj->nab", c_a, bend, c_a) - np.einsum("nk,nabk->nab", slope, rest)
        h_ab /= along[:, None, None]
        return np.column_stack([h, h_a, h_ab[:, 0, 0], h_ab[:, 0, 1], h_ab[:, 1, 1]]), fine

    def _sharp(self, points: Array) -> np.ndarray:
        """True (m,) for points where the surface is bent outwards more sharply than `_SHARPEST`."""
        _, slope, bend = field_derivatives(self._field.parameters, points)
        size = np.linalg.norm(slope, axis=1)[:, None, None]
        across = np.eye(3) - slope[:, :, None] * slope[:, None, :] / size**2
        return np.asarray(np.linalg.eigvalsh(across @ (bend / size) @ across)[:, -1] > _SHARPEST)

    def _continued(self, u: Array, v: Array) -> Array:
        """h and its derivatives (m, 6) of a quadric through the points on the mesh around (u, v)."""
        at = np.argwhere(self._smooth)
        there = self._origin + at * self._step
        heights = self._heights[self._smooth]
        tree = cKDTree(there)
        jets = np.empty((len(u), 6))
        for k, point in enumerate(np.stack([u, v], 1)):
            away, nearest = tree.query(point, _FEWEST)
            near = tree.query_ball_point(point, away[0] + _AROUND_MM)
            near = nearest if len(near) < _FEWEST else near
            x, y = (there[near] - point).T
            terms = np.stack([x**0, x, y, 0.5 * x * x, x * y, 0.5 * y * y], 1)
            jets[k] = np.linalg.lstsq(terms, heights[near], rcond=1e-6)[0]
        return jets


def _surface_at(lines: Lines, jet: Array, known: np.ndarray) -> Surface:
    """The surface at the height h along lines, by h and its derivatives u, v, uu, uv, vv (m, 6)."""
    h, up = jet[:, 0, None, None], lines.ups[:, None]
    h_a, h_ab = jet[:, 1:3, None], jet[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 1)
    tangents = lines.start_slopes + h_a * up + h * lines.up_slopes
    turns = h_a[:, :, None] * lines.up_slopes[:, None]
    second = h_ab * up[:, None] + turns + np.swapaxes(turns, 1, 2) + h[..., None] * lines.up_bends
    c_u, c_v = tangents[:, 0], tangents[:, 1]
    N = np.cross(c_v, c_u)
    slopes = np.cross(second[:, :, 1], c_u[:, None]) + np.cross(c_v[:, None], second[:, :, 0])
    length = np.linalg.norm(N, axis=1)[:, None] * np.sign(np.einsum("nk,nk->n", N, lines.ups))[:, None]
    n, turned = N / length, slopes / length[..., None]
    bends = turned - n[:, None] * np.einsum("nk,nak->na", n, turned)[..., None]
    return Surface(lines.starts + jet[:, :1] * lines.ups, n, tangents, bends, known)
