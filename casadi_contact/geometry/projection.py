"""Projections of a fixed surface onto a plane (u, v) [mm]: along parallel lines, or from the middle of a cup.

A point of the plane stands for the line p(h) = s(u, v) + h·e(u, v) with the unit vector e, which points to where the
moving body comes from; the surface is what a ray against e meets first. Lines of a central projection all begin at the
middle of a cup, s, and h = -r; a sphere of radius R about it is laid out about its pole so that areas keep their size
(Lambert's azimuthal map): u² + v² = (2R·sin(θ/2))² at the angle θ from the pole.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.triangle_mesh import TriangleMesh

DOWN = (0.0, -1.0, 0.0)
LEAST_UPWARD = 0.2  # cos of a surface's normal to its line: walls steeper than 78 degrees are not laid out


@dataclass(frozen=True)
class Lines:
    """s, e (m, 3), their gradients by (u, v) (m, 2, 3), and the Hessian of e (m, 2, 2, 3)."""

    starts: Array
    ups: Array
    start_gradients: Array
    up_gradients: Array
    up_hessians: Array


@dataclass(frozen=True, eq=False)
class ParallelProjection:
    """Along the second row of a frame (3, 3), over the plane of the other two; remedy: where rays meet no surface."""

    frame: Array
    remedy = "check geometry.axes and geometry.pressing"

    @property
    def seen_from(self) -> str:
        """The axis nearest to against `pressing`."""
        return axis_name(self.frame[1])

    def lines(self, u: Array, v: Array) -> Lines:
        """The lines of points (m,), (m,) of the plane, all alike but for where they begin."""
        first, up, second = self.frame
        shape = (len(u), 2, 3)
        return Lines(
            u[:, None] * first + v[:, None] * second,
            np.broadcast_to(up, (len(u), 3)),
            np.broadcast_to([first, second], shape),
            np.zeros(shape),
            np.zeros((len(u), 2, 2, 3)),
        )

    def spread(self, h: Array) -> Array:
        """The area across the lines at h (m,) that unit area of the plane stands for: 1 anywhere."""
        return np.ones_like(h)

    def bounds(self, mesh: TriangleMesh, box: tuple[Array, Array]) -> tuple[Array, Array, float]:
        """Lowest and highest (u, v) of what a box may hold of the mesh, and the h from which rays meet all of it."""
        low, high = np.maximum(mesh.vertices_mm.min(axis=0), box[0]), np.minimum(mesh.vertices_mm.max(axis=0), box[1])
        corners = np.array(list(itertools.product(*zip(low, high, strict=True)))) @ self.frame.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        return low[[0, 2]], high[[0, 2]], float(high[1]) + 1.0


@dataclass(frozen=True, eq=False)
class CentralProjection:
    """From a cup's middle, about the pole that lies against the second row of a frame (3, 3) from there."""

    frame: Array
    centre_mm: Array
    radius_mm: float
    least_k2: float = 0.05  # of Lambert's map: 154 degrees from the pole
    remedy = "expected the middle of a cup's curvature [mm], in its hollow"

    @property
    def seen_from(self) -> str:
        """The cup's middle."""
        return f"geometry.cup_centre = {self.centre_mm.tolist()}"

    def lines(self, u: Array, v: Array) -> Lines:
        """With k = √(1 - (u² + v²)/4R²): e = (1 - 2(1 - k²))·up - k·(u, v)/R."""
        first, up, second = self.frame
        axes = np.array([first, second])
        x = np.stack([u, v], 1) / self.radius_mm
        k = np.sqrt(np.maximum(1.0 - 0.25 * (x**2).sum(axis=1), self.least_k2))[:, None]
        flat, k_a = x @ axes, -0.25 * x / k
        k_ab = -0.25 * np.eye(2) / k[..., None] - k_a[:, :, None] * k_a[:, None, :] / k[..., None]
        ups = (2.0 * k**2 - 1.0) * up - k * flat
        gradients = -x[..., None] * up - k_a[..., None] * flat[:, None] - k[..., None] * axes
        turns = k_a[:, :, None, None] * axes
        hessians = -np.eye(2)[..., None] * up - k_ab[..., None] * flat[:, None, None] - turns - np.swapaxes(turns, 1, 2)
        starts = np.broadcast_to(self.centre_mm, ups.shape)
        return Lines(starts, ups, np.zeros_like(gradients), gradients / self.radius_mm, hessians / self.radius_mm**2)

    def spread(self, h: Array) -> Array:
        """(h/R)²: areas grow with the square of the distance."""
        return (h / self.radius_mm) ** 2

    def bounds(self, mesh: TriangleMesh, box: tuple[Array, Array]) -> tuple[Array, Array, float]:
        """Of the triangles that face the middle, and 0."""
        away = _facing(mesh, self.centre_mm)
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        k2 = np.maximum(0.5 - 0.5 * away @ self.frame[1], self.least_k2)
        places = self.radius_mm * (away @ self.frame[[0, 2]].T) / np.sqrt(k2)[:, None]
        return places.min(axis=0), places.max(axis=0), 0.0


Projection = ParallelProjection | CentralProjection
"""What a grid of elements and a chart of cells are laid out by."""


def projection_of(pressing: Sequence[float], centre_mm: Sequence[float] | None, mesh: TriangleMesh) -> Projection:
    """Along `pressing`, or from the middle of a cup, its pole along `pressing`; ValueError where no mesh faces that."""
    frame = grid_frame(pressing)
    if centre_mm is None:
        return ParallelProjection(frame)
    centre = np.asarray(centre_mm, dtype=float)
    return CentralProjection(frame, centre, float(np.median(np.linalg.norm(_facing(mesh, centre), axis=1))))


def grid_frame(pressing: Sequence[float]) -> Array:
    """Rows (3, 3): the axis of a grid's first number, that against `pressing`, that of its second number.

    They are x, y, z where `pressing` is -y; the first is as near to x, or to y where x lies along it, as can be.
    """
    up = -np.asarray(pressing, dtype=float) / np.linalg.norm(pressing)
    rough = np.eye(3)[0 if abs(up[0]) < np.sqrt(0.5) else 1]
    first = rough - (rough @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, up, np.cross(first, up)]) + 0.0


def axis_name(direction: Array) -> str:
    """The signed axis nearest to a direction: "-y"."""
    axis = int(np.abs(direction).argmax())
    return f"{'-' if direction[axis] < 0.0 else '+'}{'xyz'[axis]}"


def _facing(mesh: TriangleMesh, centre_mm: Array) -> Array:
    """Corners (n, 3), from the middle of a cup, of the triangles that face it."""
    corners, area = mesh.corners_mm - centre_mm, mesh.area_vectors_mm2
    middle = corners.mean(axis=1)
    size = np.linalg.norm(middle, axis=1) * np.linalg.norm(area, axis=1)
    faces = np.einsum("nk,nk->n", middle, area) < -LEAST_UPWARD * size
    if not faces.any():
        raise ValueError(
            f"mesh {mesh.name}: none of it faces geometry.cup_centre = {centre_mm.tolist()}, {CentralProjection.remedy}"
        )
    return np.asarray(corners[faces].reshape(-1, 3))
