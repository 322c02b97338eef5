"""Charts of fixed surfaces: points, normals and their derivatives over coordinates (u, v) [mm].

A mesh is seen from where the moving body comes: from above, u = x and v = z, or along the scene's `pressing` in the
axes of `grid_frame`. It is the zero of its distance field over each point. Beyond its edge, where the cells of the rim
still need corners, it goes on as the quadric through the points around. A spherical cup is laid out
about its pole so that areas keep their size (Lambert's azimuthal map): u² + v² = (2R·sin(θ/2))² at the angle θ. A
plane is its own chart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.conventions import Array
from casadi_contact.geometry.field_derivatives import field_derivatives
from casadi_contact.geometry.mesh_elements import DOWN, grid_frame, grid_on_mesh, grid_range
from casadi_contact.scenes import Scene

CELL_SHAPES = ("mesh", "ball_in_cup", "sphere_on_plane", "cylinder_on_plane", "punch_on_plane")
_STEPS = 6  # of Newton's method along the rays
_LEAST_UPWARD = 0.2  # of n against them, as for elements
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
        return _height_surface(u, v, np.zeros((len(u), 6)), np.ones(len(u), dtype=bool))


class CupChart:
    """The inside of a spherical cap."""

    def __init__(self, scene: Scene) -> None:
        g = scene.geometry
        self.radius, self.centre = float(g["cup_radius"]), np.asarray(g["cup_centre"], dtype=float)
        self.rim = 2.0 * self.radius * np.sin(0.5 * np.deg2rad(g["cup_half_angle_deg"]))
        self.low, self.high = np.full(2, -self.rim), np.full(2, self.rim)
        pole = np.asarray(g["cup_pole"], dtype=float)
        self.pole = pole / np.linalg.norm(pole)
        least = np.eye(3)[np.abs(self.pole).argmin()]
        self.first = np.cross(least, self.pole)
        self.first /= np.linalg.norm(self.first)
        self.second = np.cross(self.pole, self.first)

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Within the rim's circle."""
        return np.asarray(u[:, None] ** 2 + v[None, :] ** 2 <= self.rim**2)

    def surface(self, u: Array, v: Array) -> Surface:
        """With e the direction from the cup's centre, k = √(1 - (u² + v²)/4R²): e = (1 - 2(1 - k²))·pole + k·(u, v)/R;
        the point is centre + R·e, the normal -e."""
        x, y = (np.clip(w / self.radius, -1.35, 1.35) for w in (u, v))
        k = np.sqrt(np.maximum(1.0 - 0.25 * (x * x + y * y), 0.05))
        flat = x[:, None] * self.first + y[:, None] * self.second
        e = (1.0 - 0.5 * (x * x + y * y))[:, None] * self.pole + k[:, None] * flat
        slopes = [
            (-w[:, None] * self.pole + k[:, None] * axis - (0.25 * w / k)[:, None] * flat) / self.radius
            for w, axis in ((x, self.first), (y, self.second))
        ]
        e_slopes = np.stack(slopes, 1)
        known = u**2 + v**2 <= self.rim**2
        return Surface(self.centre + self.radius * e, -e, self.radius * e_slopes, -e_slopes, known)


class MeshChart:
    """The part of a fixed mesh that a patch's box holds, seen along `pressing`."""

    def __init__(self, scene: Scene, patch: str) -> None:
        from casadi_contact.shapes.mesh_bodies import body_field, patch_box
        from casadi_contact.shapes.mesh_patches import patch_mesh

        self._pressing = scene.geometry.get("pressing", DOWN)
        self._frame = grid_frame(self._pressing)  # its second axis is up: heights below are along it
        self._mesh = patch_mesh(scene.geometry, patch, reaching=True)
        self._field = body_field(scene.geometry, "fixed")
        self._box = patch_box(scene.geometry, patch)
        low, high = grid_range(self._mesh, self._box, self._frame)
        self.low, self.high = low[[0, 2]], high[[0, 2]]

    def present(self, u: Array, v: Array) -> np.ndarray:
        """Where a ray from above meets the mesh inside the box, and no wall."""
        points, _, areas = grid_on_mesh(self._mesh, self._field, (len(u), len(v)), self._box, self._pressing)
        present = areas > 0.0
        self._heights, self._present = points @ self._frame[1], present
        self._origin, self._step = np.array([u[0], v[0]]), np.array([u[1] - u[0], v[1] - v[0]])
        return present

    def surface(self, u: Array, v: Array) -> Surface:
        """From the distance field where the four points of `present` around are on the mesh, continued elsewhere."""
        place = (np.stack([u, v], 1) - self._origin) / self._step
        first = np.clip(np.floor(place).astype(int), 0, np.array(self._present.shape) - 2)
        corners = [(first[:, 0] + a, first[:, 1] + b) for a in (0, 1) for b in (0, 1)]
        known = np.all([self._present[corner] for corner in corners], axis=0)
        height = np.mean([self._heights[corner] for corner in corners], axis=0)
        jet = np.zeros((len(u), 6))
        jet[known], found = self._jets(u[known], height[known], v[known])
        known[np.flatnonzero(known)[~found]] = False
        if not known.all():
            jet[~known] = self._continued(u[~known], v[~known])
        seen, frame = _height_surface(u, v, jet, known), self._frame
        return Surface(seen.c @ frame, seen.n @ frame, seen.tangents @ frame, seen.bends @ frame, known)

    def _jets(self, x: Array, y: Array, z: Array) -> tuple[Array, np.ndarray]:
        """y and its derivatives x, z, xx, xz, zz (m, 6) on the field's zero, in the frame; False for a wall (m,)."""
        points, frame = np.stack([x, y, z], 1), self._frame
        for _ in range(_STEPS):
            g, slope = self._field(points @ frame)
            points[:, 1] -= g / np.maximum(slope @ frame[1], _LEAST_UPWARD)
        _, slope, bend = field_derivatives(self._field.parameters, points @ frame)
        slope, bend = slope @ frame.T, frame @ bend @ frame.T
        fine = slope[:, 1] > _LEAST_UPWARD * np.linalg.norm(slope, axis=1)
        up = np.where(fine, slope[:, 1], 1.0)
        y_x, y_z = -slope[:, 0] / up, -slope[:, 2] / up
        along = np.stack([np.stack([y_x**0, y_x, 0.0 * y_x], 1), np.stack([0.0 * y_z, y_z, y_z**0], 1)], 1)
        second = -np.einsum("nai,nij,nbj->nab", along, bend, along) / up[:, None, None]
        return np.column_stack([points[:, 1], y_x, y_z, second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]]), fine

    def _continued(self, x: Array, z: Array) -> Array:
        """y and its derivatives (m, 6) of a quadric through the points on the mesh around (x, z)."""
        at = np.argwhere(self._present)
        there = self._origin + at * self._step
        heights = self._heights[self._present]
        tree = cKDTree(there)
        jets = np.empty((len(x), 6))
        for k, point in enumerate(np.stack([x, z], 1)):
            away, nearest = tree.query(point, _FEWEST)
            near = tree.query_ball_point(point, away[0] + _AROUND_MM)
            near = nearest if len(near) < _FEWEST else near
            u, v = (there[near] - point).T
            terms = np.stack([u**0, u, v, 0.5 * u * u, u * v, 0.5 * v * v], 1)
            jets[k] = np.linalg.lstsq(terms, heights[near], rcond=1e-6)[0]
        return jets


def _height_surface(x: Array, z: Array, jet: Array, known: np.ndarray) -> Surface:
    """A surface y(x, z) by y and its derivatives x, z, xx, xz, zz (m, 6)."""
    y, y_x, y_z, y_xx, y_xz, y_zz = jet.T
    one, zero = np.ones(len(x)), np.zeros(len(x))
    tangents = np.stack([np.stack([one, y_x, zero], 1), np.stack([zero, y_z, one], 1)], 1)
    length = np.sqrt(1.0 + y_x**2 + y_z**2)[:, None]
    n = np.stack([-y_x, one, -y_z], 1) / length
    turns = np.stack([np.stack([-y_xx, zero, -y_xz], 1), np.stack([-y_xz, zero, -y_zz], 1)], 1) / length[:, None]
    bends = turns - n[:, None] * np.einsum("nk,nak->na", n, turns)[..., None]
    return Surface(np.stack([x, y, z], 1), n, tangents, bends, known)
