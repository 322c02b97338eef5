"""Charts of fixed surfaces: points, normals and their derivatives over coordinates (u, v) [mm].

A surface lies at the height h(u, v) along the lines of a projection (`geometry.projection`); a plane is its own chart.
A mesh is seen from where the moving body comes: from above, u = x and v = z,
along the scene's `pressing`, or from a cup's middle. The surface is the zero of its distance field on each line. Beside
a sharp edge, which the field rounds off, it is the quadric h(u, v) through the points around, which lie on the mesh's
own cubic patches. So it goes on beyond its edge, where the cells of the rim still need corners, and where the mesh
turns over a blunter edge at its rim, which cubics cannot follow. Above and below a wall, as of a step, and to both
sides of a crease, as of a chamfer, lie faces with edges of their own; but the surface ends at the wall alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.projection import DOWN, LEAST_UPWARD, Lines, ParallelProjection, grid_frame, grid_on_mesh
from casadi_contact.geometry.surface_distances import field_derivatives
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.foot import sole_surface
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_surface, patch_box, patch_mesh, patch_projection
from casadi_contact.scenes.shapes.shape import Geometry


@dataclass(frozen=True)
class Surface:
    """Of m points: c (m, 3), outward normal n (m, 3), derivatives by u, v (m, 2, 3); known (m,): not beyond a rim."""

    c: Array
    n: Array
    tangents: Array
    bends: Array
    known: np.ndarray


class Chart(ABC):
    """The fixed surface of one patch over (u, v): without walls and creases, unless a chart says otherwise."""

    low: Array
    high: Array
    densities: tuple[Array, Array] = (np.ones(2), np.ones(2))  # of lines across u and across v (`patches.lay_lines`)

    @property
    def faces(self) -> Sequence[Chart]:
        """Charts of its parts, between which there are walls and creases."""
        return [self]

    @property
    def whole(self) -> Chart:
        """That of a part together with the parts beyond its creases, over which the surface goes on."""
        return self

    def present(self, u: Array, v: Array) -> np.ndarray:
        """True (nu, nv) where the surface has a point, of a grid u (nu,), v (nv,): everywhere."""
        return np.ones((len(u), len(v)), dtype=bool)

    @abstractmethod
    def surface(self, u: Array, v: Array) -> Surface:
        """The surface at points (m,), (m,)."""


class PlaneChart(Chart):
    """The rectangle y = 0 about the origin."""

    def __init__(self, length: float, width: float) -> None:
        self.high = 0.5 * np.array([length, width])
        self.low = -self.high

    def surface(self, u: Array, v: Array) -> Surface:
        """Flat."""
        lines = ParallelProjection(grid_frame(DOWN)).lines(u, v)
        return surface_at(lines, np.zeros((len(u), 6)), np.ones(len(u), dtype=bool))


class SoleChart(Chart):
    """A parametric sole over x and, across it, z at the ball of the foot."""

    def __init__(self, geometry: Geometry) -> None:
        self._sole = sole_surface(geometry)
        self._half = 0.5 * geometry["ball_width"]
        self.low = np.array([geometry["heel_x"], -self._half])
        self.high = np.array([geometry["toe_x"], self._half])

    def surface(self, u: Array, v: Array) -> Surface:
        """By its derivatives."""
        c, tangents, second = self._sole(u, v / self._half)
        scale = np.array([1.0, 1.0 / self._half])
        down = np.broadcast_to([0.0, -1.0, 0.0], c.shape)
        known = np.ones(len(u), dtype=bool)
        return surface_of(c, tangents * scale[:, None], second * np.outer(scale, scale)[..., None], down, known)


def surface_at(lines: Lines, jet: Array, known: np.ndarray) -> Surface:
    """The surface at the height h along lines, by h and its derivatives u, v, uu, uv, vv (m, 6)."""
    h, up = jet[:, 0, None, None], lines.ups[:, None]
    h_a, h_ab = jet[:, 1:3, None], jet[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 1)
    tangents = lines.start_gradients + h_a * up + h * lines.up_gradients
    turns = h_a[:, :, None] * lines.up_gradients[:, None]
    second = h_ab * up[:, None] + turns + np.swapaxes(turns, 1, 2) + h[..., None] * lines.up_hessians
    return surface_of(lines.starts + jet[:, :1] * lines.ups, tangents, second, lines.ups, known)


def surface_of(c: Array, tangents: Array, second: Array, outwards: Array, known: np.ndarray) -> Surface:
    """The surface through points c (m, 3) by first and second derivatives by u and v; outwards (m, 3): its side."""
    c_u, c_v = tangents[:, 0], tangents[:, 1]
    N = np.cross(c_v, c_u)
    slopes = np.cross(second[:, :, 1], c_u[:, None]) + np.cross(c_v[:, None], second[:, :, 0])
    length = np.linalg.norm(N, axis=1)[:, None] * np.sign(np.einsum("nk,nk->n", N, outwards))[:, None]
    n, turned = N / length, slopes / length[..., None]
    bends = turned - n[:, None] * np.einsum("nk,nak->na", n, turned)[..., None]
    return Surface(c, n, tangents, bends, known)


def segment_surface(
    on: np.ndarray, heights: Array, normals: Array, step: Array, fewest: int, crease_deg: float = 30.0
) -> tuple[np.ndarray, np.ndarray]:
    """The numbers (nu, nv) of the sheet and of the face that each point `on` (nu, nv) of a raster lies on.

    Neighbours between which the surface is no wall lie on one sheet, by their heights (nu, nv) [mm] and the raster's
    step (2,) [mm]; those whose unit normals (nu, nv, 3) differ by less than crease_deg, on one face of it. A fillet of
    0.3 mm turns by 30° in 0.15 mm. What has fewer than `fewest` points counts as the first.
    """
    level, alike = [], []
    for axis in (0, 1):
        here, there = _neighbours(on, axis)
        (low, high), (first, second) = _neighbours(heights, axis), _neighbours(normals, axis)
        level.append(here & there & (np.abs(high - low) < step[axis] / LEAST_UPWARD))
        alike.append(level[axis] & (np.einsum("uvk,uvk->uv", first, second) > np.cos(np.deg2rad(crease_deg))))
    return _components(on, level, fewest), _components(on, alike, fewest)


def _neighbours(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Values at the raster's points but the last, and but the first, along an axis."""
    return np.delete(values, -1, axis), np.delete(values, 0, axis)


def _components(on: np.ndarray, joined: Sequence[np.ndarray], fewest: int) -> np.ndarray:
    """Numbers (nu, nv) of what hangs together by the joined neighbours along u (nu - 1, nv) and v (nu, nv - 1)."""
    bridged = np.zeros((2 * on.shape[0] - 1, 2 * on.shape[1] - 1), dtype=bool)  # points, and between them what joins
    bridged[::2, ::2], bridged[1::2, ::2], bridged[::2, 1::2] = on, *joined
    of = ndimage.label(bridged)[0][::2, ::2]
    large = np.flatnonzero(np.bincount(of[on]) >= fewest)
    return np.where(np.isin(of, large), np.searchsorted(large, of), 0)


def density(convex: Array, blunt: float = 0.08, densest: float = 3.3) -> Array:
    """How many times as many cells as on the flat, by convex curvature [1/mm]: 1 up to `blunt`, `densest` at most."""
    return np.clip(np.sqrt(np.maximum(convex, 0.0) / blunt), 1.0, densest)


class MeshChart(Chart):
    """The part of a fixed mesh that a patch's box holds; it is looked for on a raster, once."""

    raster_mm, fewest_parts, most_parts = 0.15, 64, 400  # of each side
    ridge_percentile = 97  # of the curvatures along a line: a ridge may be short
    newton_steps = 6  # along the rays
    sharpest = 2.0  # curvature [1/mm] of an edge, convex: normals turn by a radian within a cell of the rim
    rounded_mm = 1e-4  # from points on the surface to the field's zero: more beside a sharp edge
    around_mm = 1.0  # reach of the quadric: farther away a dome of 10 mm is bent otherwise
    fewest = 12  # points that it goes through

    def __init__(self, scene: Scene, patch: str) -> None:
        self._projection = patch_projection(scene.geometry, patch)
        self._mesh = patch_mesh(scene.geometry, patch, reaching=True)
        self._field = body_field(scene.geometry, "fixed")
        box = patch_box(scene.geometry, patch)
        self.low, self.high, _ = self._projection.bounds(self._mesh, box)
        wanted = np.ceil((self.high - self.low) / self.raster_mm).astype(int)
        counts = np.clip(wanted, self.fewest_parts, self.most_parts)
        self._step = (self.high - self.low) / counts
        u, v = (self.low[k] + self._step[k] * (np.arange(count) + 0.5) for k, count in enumerate(counts))
        surface = partial(body_surface, scene.geometry, "fixed")
        grid = (len(u), len(v))
        points, normals, areas = grid_on_mesh(self._mesh, self._field, grid, box, self._projection, surface)
        self._present = present = areas > 0.0
        lines = self._projection.lines(*(values.ravel() for values in np.meshgrid(u, v, indexing="ij")))
        heights = np.einsum("nk,nk->n", points.reshape(-1, 3) - lines.starts, lines.ups)
        self._heights = heights.reshape(areas.shape)
        on = points.reshape(-1, 3)
        rounded = np.abs(self._field(on)[0]).reshape(areas.shape) > self.rounded_mm
        edge = present & ~rounded & self._sharp(on).reshape(areas.shape)
        ends = ~ndimage.binary_erosion(present, np.ones((3, 3)))
        self._smooth = present & ~ndimage.binary_propagation(edge & ends, np.ones((3, 3)), edge)
        self._followed = self._smooth & ~rounded
        self._whole: MeshChart | None = None
        nearest = tuple(ndimage.distance_transform_edt(~self._smooth, return_distances=False, return_indices=True))
        segments = segment_surface(self._smooth, self._heights, normals, self._step, self.fewest)
        self._sheets, self._faces = (numbers[nearest] for numbers in segments)
        self.densities = self._densities(u[1::2], v[1::2])

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Where a ray meets the mesh inside the box, and no wall, at the nearest places of the raster."""
        places = (self._nearest(values, axis) for axis, values in enumerate((u, v)))
        return np.asarray(self._present[np.ix_(*places)])

    @property
    def faces(self) -> Sequence[MeshChart]:
        """Above and below walls, and to both sides of creases."""
        found = []
        for number in range(self._faces.max() + 1):
            here = self._faces == number
            face = self._part(here)
            face._whole = self._part(self._sheets == np.bincount(self._sheets[here]).argmax())
            found.append(face)
        return found

    @property
    def whole(self) -> MeshChart:
        """Of a face, what lies between walls."""
        return self._whole or self

    def _part(self, here: np.ndarray) -> MeshChart:
        """What lies at these places (nu, nv) of the raster."""
        part = copy(self)
        part._present, part._smooth = self._present & here, self._smooth & here
        part._followed = self._followed & here
        return part

    def _nearest(self, values: Array, axis: int) -> np.ndarray:
        place = np.floor((values - self.low[axis]) / self._step[axis]).astype(int)
        return np.clip(place, 0, self._present.shape[axis] - 1)

    def surface(self, u: Array, v: Array) -> Surface:
        """Of the field where the four raster points around lie on it and not on its rim's edge, else quadrics."""
        followed, height = self._around(u, v, self._followed)
        jet = np.zeros((len(u), 6))
        jet[followed], found = self._jets(self._projection.lines(u[followed], v[followed]), height[followed])
        followed[np.flatnonzero(followed)[~found]] = False
        if not followed.all():
            jet[~followed] = self._quadrics(u[~followed], v[~followed])
        known = followed | self._around(u, v, self._smooth)[0]
        return surface_at(self._projection.lines(u, v), jet, known)

    def _around(self, u: Array, v: Array, on: np.ndarray) -> tuple[np.ndarray, Array]:
        """Whether the four points of the raster around are among those `on` (m,), and their mean height (m,) [mm]."""
        place = (np.stack([u, v], 1) - self.low) / self._step - 0.5
        first = np.clip(np.floor(place).astype(int), 0, np.array(self._smooth.shape) - 2)
        corners = [(first[:, 0] + a, first[:, 1] + b) for a in (0, 1) for b in (0, 1)]
        known = np.all([on[corner] for corner in corners], axis=0)
        return known, np.mean([self._heights[corner] for corner in corners], axis=0)

    def _densities(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Of lines across u (nu,) and across v (nv,), by the convex curvature along u and along v."""
        at_u, at_v = (values.ravel() for values in np.meshgrid(u, v, indexing="ij"))
        known, height = self._around(at_u, at_v, self._followed)
        lines = self._projection.lines(at_u[known], at_v[known])
        jet, found = self._jets(lines, height[known])
        surface = surface_at(lines, jet, found)
        bent = np.einsum("nak,nak->na", surface.bends, surface.tangents)
        curvature = np.zeros((len(at_u), 2))
        curvature[known] = np.where(found[:, None], bent / (surface.tangents**2).sum(axis=2), 0.0)
        along_u, along_v = np.moveaxis(curvature.reshape(len(u), len(v), 2), 2, 0)
        return (
            density(np.percentile(along_u, self.ridge_percentile, axis=1)),
            density(np.percentile(along_v, self.ridge_percentile, axis=0)),
        )

    def _jets(self, lines: Lines, h: Array) -> tuple[Array, np.ndarray]:
        """h and its derivatives u, v, uu, uv, vv (m, 6) on the field's zero; False for a wall (m,)."""
        up, h = lines.ups, h.copy()
        for _ in range(self.newton_steps):
            g, slope = self._field(lines.starts + h[:, None] * up)
            h -= g / np.maximum(np.einsum("nk,nk->n", slope, up), LEAST_UPWARD)
        _, slope, bend = field_derivatives(self._field.parameters, lines.starts + h[:, None] * up)
        along = np.einsum("nk,nk->n", slope, up)
        fine = along > LEAST_UPWARD * np.linalg.norm(slope, axis=1)
        along = np.where(fine, along, 1.0)
        across = lines.start_gradients + h[:, None, None] * lines.up_gradients
        h_a = -np.einsum("nk,nak->na", slope, across) / along[:, None]
        c_a = across + h_a[..., None] * up[:, None]
        turns = h_a[:, :, None, None] * lines.up_gradients[:, None]
        rest = turns + np.swapaxes(turns, 1, 2) + h[:, None, None, None] * lines.up_hessians
        h_ab = -np.einsum("nai,nij,nbj->nab", c_a, bend, c_a) - np.einsum("nk,nabk->nab", slope, rest)
        h_ab /= along[:, None, None]
        return np.column_stack([h, h_a, h_ab[:, 0, 0], h_ab[:, 0, 1], h_ab[:, 1, 1]]), fine

    def _sharp(self, points: Array) -> np.ndarray:
        """True (m,) for points where the surface is bent outwards more sharply than `sharpest`."""
        _, slope, bend = field_derivatives(self._field.parameters, points)
        size = np.linalg.norm(slope, axis=1)[:, None, None]
        across = np.eye(3) - slope[:, :, None] * slope[:, None, :] / size**2
        return np.asarray(np.linalg.eigvalsh(across @ (bend / size) @ across)[:, -1] > self.sharpest)

    def _quadrics(self, u: Array, v: Array) -> Array:
        """h and its derivatives (m, 6) at (u, v), of quadrics through the points on the mesh around."""
        at = np.argwhere(self._smooth)
        there = self.low + (at + 0.5) * self._step
        heights = self._heights[self._smooth]
        tree = cKDTree(there)
        jets = np.empty((len(u), 6))
        for k, point in enumerate(np.stack([u, v], 1)):
            away, nearest = tree.query(point, self.fewest)
            near = tree.query_ball_point(point, away[0] + self.around_mm)
            near = nearest if len(near) < self.fewest else near
            x, y = (there[near] - point).T
            terms = np.stack([x**0, x, y, 0.5 * x * x, x * y, 0.5 * y * y], 1)
            jets[k] = np.linalg.lstsq(terms, heights[near], rcond=1e-6)[0]
        return jets
