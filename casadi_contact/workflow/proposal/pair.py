"""Two meshes and how near they are to each other: what the proposal of a scene is found from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, build_field
from casadi_contact.geometry.triangle_mesh import TriangleMesh, joined_by_edges

_SPACING_MM = 1.5
_COARSE_MM = 4.0  # longest edge of triangles whose centres alone tell where the surface is
_FULL_SIZE_MM = 40.0  # across: a fixed surface smaller than this, of a finger, is looked at on a smaller scale
_FULL_PIECE_MM = 28.0  # across: a surface whose largest piece is smaller, less than a plateau of a knee, carries less
_PIECE_SHARE = 0.25  # of the area, in the largest piece: less, and the file is in fragments
_MOST_POINTS = 6000
_FACING = 0.5  # cos of the angle between a fixed normal and the direction to the moving body, at least
_AHEAD = 0.7  # cos of the angle to the direction of moving
_LEAST_CURVED = 2e-3  # mean square of the angle [rad] that normals differ by, for their lines to have a centre
_TOUCH_MM = 0.02
_TOUCH_STEPS = 100


@dataclass(frozen=True, eq=False)
class Pair:
    """Points (n, 3) of the fixed mesh, their outward normals and areas [mm²], and the moving mesh's distance field.

    scale: of this joint's size to that of large ones, 1 at most: what the lengths of this subpackage are multiplied by.
    carrying: the same of its largest piece, whose square is the share of a large joint's load that it carries.
    is_open: whether the fixed mesh has edges of one triangle.
    """

    points_mm: Array
    normals: Array
    areas_mm2: Array
    field: DistanceField
    moving: TriangleMesh
    scale: float
    carrying: float
    is_open: bool

    @classmethod
    def of(cls, moving: TriangleMesh, fixed: TriangleMesh) -> Pair:
        """The fixed mesh's triangles by their centres, large ones divided, thinned out evenly where there are very
        many."""
        scale = min(1.0, across_mm(fixed) / _FULL_SIZE_MM)
        carrying = min(scale, across_mm(largest_piece(fixed)) / _FULL_PIECE_MM)
        is_open = bool(len(fixed.boundary_edges))
        fixed = _divided(fixed, scale * _COARSE_MM)
        chosen = np.linspace(0, len(fixed.faces) - 1, min(len(fixed.faces), _MOST_POINTS)).round().astype(int)
        vectors = fixed.area_vectors_mm2[chosen] * (len(fixed.faces) / len(chosen))
        areas = np.linalg.norm(vectors, axis=1)
        points = fixed.corners_mm[chosen].mean(axis=1)
        return cls(
            points,
            vectors / areas[:, None],
            areas,
            build_field(moving, scale * _SPACING_MM),
            moving,
            scale,
            carrying,
            is_open,
        )

    def turned_round(self) -> Pair:
        """The same with the outside of the moving surface where its inside is."""
        moving = TriangleMesh(self.moving.name, self.moving.vertices_mm, self.moving.faces[:, ::-1])
        return replace(self, field=build_field(moving, self.scale * _SPACING_MM), moving=moving)

    def distances(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Signed distances (n,) [mm] of the fixed points from the moving body and their gradients (n, 3), fixed frame,
        with the moving body turned by R and moved by t."""
        distance, slope = self.field((self.points_mm - t) @ R)
        return distance, slope @ R.T

    def near(self, R: Array, t: Array, reach_mm: float, *, backs: bool = False) -> np.ndarray:
        """True (n,) for fixed points within reach of the moving body that face it; backs: that face away from it."""
        distance, slope = self.distances(R, t)
        facing = np.einsum("nk,nk->n", slope, self.normals) * (1.0 if backs else -1.0)
        return np.asarray((distance < reach_mm) & (facing > _FACING))

    def dropped(self, R: Array, t: Array, direction: Array) -> Array | None:
        """The translation (3,) at which the body, coming along a direction from clear of the fixed one, first touches
        it: steps of the smallest gap never pass a surface. None where it passes by, and where it comes with the
        hollow of an open surface ahead: behind one, distances are negative however far it is."""
        size = np.linalg.norm(np.ptp(self.points_mm, axis=0)) + np.linalg.norm(np.ptp(self.moving.vertices_mm, axis=0))
        here = self.moving.vertices_mm @ R.T + t
        back = (here @ direction).max() - (self.points_mm @ direction).min()
        t, travelled = t - (back + 1.0) * direction, 0.0
        for _ in range(_TOUCH_STEPS):
            gap = float(self.distances(R, t)[0].min())
            if gap < _TOUCH_MM:
                return t if gap > -self.scale * _SPACING_MM else None
            t, travelled = t + gap * direction, travelled + gap
            if travelled > 2.0 * size:
                return None
        return t

    def touching(self, R: Array, t: Array, direction: Array) -> Array:
        """The translation (3,) near `t` at which the bodies just touch, moved along a direction, back where they
        overlap. Only where the bodies face along the direction: walls that it slides past do not count."""
        for _ in range(_TOUCH_STEPS):
            distance, slope = self.distances(R, t)
            facing = (slope @ direction > _AHEAD) & (self.normals @ direction < -_AHEAD)
            gap = float(distance[facing].min(initial=np.inf))
            if not _TOUCH_MM < abs(gap) < np.inf:
                break
            t = t + gap * direction
        return t


def across_mm(mesh: TriangleMesh) -> float:
    """Largest extent along an axis."""
    return float(np.ptp(mesh.vertices_mm, axis=0).max())


def largest_piece(mesh: TriangleMesh) -> TriangleMesh:
    """That of the largest area of the pieces that do not hang together, as the two facets of a vertebra; all of it
    where the file is in fragments."""
    group = joined_by_edges(mesh.faces)[0]
    areas = np.bincount(group, weights=mesh.areas_mm2)
    if areas.max() < _PIECE_SHARE * areas.sum():
        return mesh
    used, faces = np.unique(mesh.faces[group == np.argmax(areas)], return_inverse=True)
    return TriangleMesh(mesh.name, mesh.vertices_mm[used], faces.reshape(-1, 3))


def _divided(mesh: TriangleMesh, longest_mm: float) -> TriangleMesh:
    """The mesh with triangles halved until no edge is longer; flat faces from CAD are a few large ones. As it is where
    most of its surface is made of small ones."""
    import trimesh

    edges = np.linalg.norm(mesh.corners_mm - np.roll(mesh.corners_mm, 1, axis=1), axis=2).max(axis=1)
    areas = mesh.areas_mm2
    if areas[edges > longest_mm].sum() < 0.5 * areas.sum():
        return mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices_mm, mesh.faces, longest_mm, max_iter=20)
    return TriangleMesh(mesh.name, np.asarray(vertices), np.asarray(faces))


def centre_of_normals(points_mm: Array, normals: Array, weights: Array) -> Array:
    """The point (3,) that lines through the points along their normals pass nearest to: a sphere's centre, a condyle's
    axis. It stays near the points where the lines are nearly parallel."""
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    weights = weights / weights.sum()
    middle = weights @ points_mm
    held = _LEAST_CURVED * np.eye(3)
    return np.asarray(
        middle
        + np.linalg.solve(
            np.einsum("n,nij->ij", weights, across) + held,
            np.einsum("n,nij,nj->i", weights, across, points_mm - middle),
        )
    )


def axis_of_normals(points_mm: Array, normals: Array, weights: Array) -> tuple[Array, Array]:
    """A point (3,) on the axis about which the points turn most nearly within their surface, and its unit direction
    (3,): a spool's.

    With v + ω × x the speed of a point x, that is the least Σ w (n·v + (x × n)·ω)² with |ω| = 1, over all screws.
    """
    middle = weights @ points_mm / weights.sum()
    rows = np.sqrt(weights)[:, None] * np.hstack([normals, np.cross(points_mm - middle, normals)])
    of_v, mixed, of_w = rows[:, :3].T @ rows[:, :3], rows[:, :3].T @ rows[:, 3:], rows[:, 3:].T @ rows[:, 3:]
    best_v = -np.linalg.pinv(of_v, hermitian=True) @ mixed  # of each ω
    turn = np.linalg.eigh(of_w + mixed.T @ best_v)[1][:, 0]
    return np.asarray(middle + np.cross(turn, best_v @ turn)), turn
