"""Two meshes and how near they are to each other: the input of every step of the proposal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class PairSettings:
    """Lengths [mm] of a large joint; they are multiplied by `Pair.scale`."""

    spacing_mm: float = 1.5  # of the distance field
    longest_edge_mm: float = 4.0  # triangles with longer edges are divided: their centres represent the surface
    full_size_mm: float = 40.0  # extent of the fixed surface of a large joint
    most_points: int = 6000
    facing_cos: float = 0.5  # least cosine between a fixed normal and the direction to the moving body
    ahead_cos: float = 0.7  # least cosine between a normal and the direction of motion
    touch_mm: float = 0.02
    most_steps: int = 100


SETTINGS = PairSettings()


@dataclass(frozen=True, eq=False)
class Pair:
    """Points (n, 3) of the fixed mesh, their outward normals and areas [mm²], and the moving mesh's distance field.

    scale: size of this joint relative to a large one, at most 1. It multiplies all lengths of the proposal.
    is_open: the fixed mesh has open edges.
    """

    points_mm: Array
    normals: Array
    areas_mm2: Array
    field: DistanceField
    moving: TriangleMesh
    scale: float
    is_open: bool

    @classmethod
    def of(cls, moving: TriangleMesh, fixed: TriangleMesh) -> Pair:
        """Represent the fixed mesh by the centres of its triangles; divide large ones, thin out very many evenly."""
        scale = min(1.0, extent_mm(fixed) / SETTINGS.full_size_mm)
        is_open = bool(len(fixed.boundary_edges))
        fixed = _divided(fixed, scale * SETTINGS.longest_edge_mm)
        count = min(len(fixed.faces), SETTINGS.most_points)
        chosen = np.linspace(0, len(fixed.faces) - 1, count).round().astype(int)
        vectors = fixed.area_vectors_mm2[chosen] * (len(fixed.faces) / len(chosen))
        areas = np.linalg.norm(vectors, axis=1)
        field = build_field(moving, scale * SETTINGS.spacing_mm)
        points = fixed.corners_mm[chosen].mean(axis=1)
        return cls(points, vectors / areas[:, None], areas, field, moving, scale, is_open)

    def turned_inside_out(self) -> Pair:
        """The same pair with the orientation of the moving surface reversed."""
        moving = TriangleMesh(self.moving.name, self.moving.vertices_mm, self.moving.faces[:, ::-1])
        return replace(self, field=build_field(moving, self.scale * SETTINGS.spacing_mm), moving=moving)

    def distances(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Signed distances (n,) [mm] of the fixed points from the moving body at (R, t), and their gradients (n, 3) in
        the fixed frame."""
        distance, gradient = self.field((self.points_mm - t) @ R)
        return distance, gradient @ R.T

    def near(self, R: Array, t: Array, reach_mm: float, *, backs: bool = False) -> np.ndarray:
        """Mask (n,) of fixed points within reach of the moving body that face it (backs: that face away from it)."""
        distance, gradient = self.distances(R, t)
        facing = np.einsum("nk,nk->n", gradient, self.normals) * (1.0 if backs else -1.0)
        return np.asarray((distance < reach_mm) & (facing > SETTINGS.facing_cos))

    def dropped(self, R: Array, t: Array, direction: Array) -> Array | None:
        """The translation (3,) of first touch if the moving body comes along a direction from far away.

        Steps of the smallest gap never pass a surface. None if the body passes by, or comes with the hollow side of an
        open surface ahead, behind which distances are negative.
        """
        size = np.linalg.norm(np.ptp(self.points_mm, axis=0)) + np.linalg.norm(np.ptp(self.moving.vertices_mm, axis=0))
        vertices = self.moving.vertices_mm @ R.T + t
        back = (vertices @ direction).max() - (self.points_mm @ direction).min()
        t, travelled = t - (back + 1.0) * direction, 0.0
        for _ in range(SETTINGS.most_steps):
            gap = float(self.distances(R, t)[0].min())
            if gap < SETTINGS.touch_mm:
                return t if gap > -self.scale * SETTINGS.spacing_mm else None
            t, travelled = t + gap * direction, travelled + gap
            if travelled > 2.0 * size:
                return None
        return t

    def touching(self, R: Array, t: Array, direction: Array) -> Array:
        """The translation (3,) near `t` at which the bodies just touch, moved along a direction or back.

        Counts only points at which both surfaces face along the direction, not walls that the body slides past.
        """
        for _ in range(SETTINGS.most_steps):
            distance, gradient = self.distances(R, t)
            ahead = SETTINGS.ahead_cos
            facing = (gradient @ direction > ahead) & (self.normals @ direction < -ahead)
            gap = float(distance[facing].min(initial=np.inf))
            if not SETTINGS.touch_mm < abs(gap) < np.inf:
                break
            t = t + gap * direction
        return t


def extent_mm(mesh: TriangleMesh) -> float:
    """Largest extent along an axis."""
    return float(np.ptp(mesh.vertices_mm, axis=0).max())


def _divided(mesh: TriangleMesh, longest_mm: float) -> TriangleMesh:
    """The mesh without longer edges, unless most of its area has short edges already."""
    edges = np.linalg.norm(mesh.corners_mm - np.roll(mesh.corners_mm, 1, axis=1), axis=2).max(axis=1)
    areas = mesh.areas_mm2
    is_fine = areas[edges > longest_mm].sum() < 0.5 * areas.sum()
    return mesh if is_fine else mesh.subdivided(longest_mm)


def unit_rows(vectors: Array) -> Array:
    """Vectors (n, 3) divided by their lengths."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def centre_of_normals(points_mm: Array, normals: Array, weights: Array, regularisation: float = 2e-3) -> Array:
    """The point (3,) nearest to the lines through the points along their normals: a sphere's centre, a condyle's axis.

    Minimises Σ w |(I - n nᵀ)(x - p)|² + regularisation · |x - mean|², which stays near the points if the lines are
    nearly parallel.
    """
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    weights = weights / weights.sum()
    middle = weights @ points_mm
    matrix = np.einsum("n,nij->ij", weights, across) + regularisation * np.eye(3)
    return np.asarray(middle + np.linalg.solve(matrix, np.einsum("n,nij,nj->i", weights, across, points_mm - middle)))


def axis_of_normals(points_mm: Array, normals: Array, weights: Array) -> tuple[Array, Array]:
    """A point (3,) on the axis of revolution of a surface, and the axis' unit direction (3,).

    With the velocity v + ω × x of a point x, it minimises Σ w (n·v + (x × n)·ω)² with |ω| = 1 over all screws.
    """
    middle = weights @ points_mm / weights.sum()
    rows = np.sqrt(weights)[:, None] * np.hstack([normals, np.cross(points_mm - middle, normals)])
    of_v, mixed, of_w = rows[:, :3].T @ rows[:, :3], rows[:, :3].T @ rows[:, 3:], rows[:, 3:].T @ rows[:, 3:]
    best_v = -np.linalg.pinv(of_v, hermitian=True) @ mixed  # for each ω
    turn = np.linalg.eigh(of_w + mixed.T @ best_v)[1][:, 0]
    return np.asarray(middle + np.cross(turn, best_v @ turn)), turn
