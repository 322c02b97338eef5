"""Elements on the smooth surface of a fixed mesh: a structured grid laid over it from above, or its triangles."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField
from casadi_contact.geometry.mesh import TriangleMesh
from casadi_contact.geometry.rays import RayCaster

_LEAST_UPWARD = 0.2  # n_y of a grid element: walls steeper than 78 degrees carry none
_ITERATIONS = 6
_LARGEST_STEP_MM = 0.5  # from triangle to smooth surface


def grid_on_mesh(
    mesh: TriangleMesh, field: DistanceField, grid: tuple[int, int], box: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Centres (nx, nz, 3), unit normals (nx, nz, 3) and areas (nx, nz) of equal cells in x and z, inside the box.

    A ray down -y through each cell's centre finds the mesh, Newton's method along y the smooth surface, whose normal
    gives the area dA = dx·dz/n_y. A cell whose ray misses the mesh, or meets a wall, has no area. Raises ValueError
    if none is left.
    """
    low, high = np.maximum(mesh.vertices_mm.min(axis=0), box[0]), np.minimum(mesh.vertices_mm.max(axis=0), box[1])
    step = (high - low)[[0, 2]] / grid
    x, z = (low[axis] + (np.arange(count) + 0.5) * d for axis, count, d in zip((0, 2), grid, step, strict=True))
    points = np.empty((*grid, 3))
    points[..., 0], points[..., 2] = np.meshgrid(x, z, indexing="ij")
    points[..., 1] = high[1] + 1.0
    starts = points.reshape(-1, 3)
    caster, down = RayCaster(mesh), np.tile([0.0, -1.0, 0.0], (len(starts), 1))
    distance, face = caster.first_hits(starts, down)
    if not (face >= 0).any():
        raise ValueError(f"mesh {mesh.name}: no ray along -y meets it on a {grid[0]}×{grid[1]} grid: check its axes")
    if caster.leaves(down, face).sum() > 0.5 * (face >= 0).sum():
        raise ValueError(f"mesh {mesh.name} shows its inside to +y, expected outward normals there: is it inside-out?")
    met = np.flatnonzero(np.isfinite(distance) & ~caster.leaves(down, face))
    centres, normals, areas = starts.copy(), np.tile([0.0, 1.0, 0.0], (len(starts), 1)), np.zeros(len(starts))
    on = starts[met] + distance[met, None] * down[met]
    flat = on[:, 1].copy()
    for _ in range(_ITERATIONS):
        value, slope = field(on)
        on[:, 1] -= value / np.maximum(slope[:, 1], _LEAST_UPWARD)
    normal = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    kept = (normal[:, 1] > _LEAST_UPWARD) & (np.abs(on[:, 1] - flat) < _LARGEST_STEP_MM)
    centres[met[kept]], normals[met[kept]] = on[kept], normal[kept]
    areas[met[kept]] = step.prod() / normal[kept, 1]
    return centres.reshape(*grid, 3), normals.reshape(*grid, 3), areas.reshape(grid)


def triangles_on_mesh(mesh: TriangleMesh, field: DistanceField) -> tuple[Array, Array, Array]:
    """Each triangle's centre (f, 3) moved onto the smooth surface, the normal there (f, 3) and its flat area (f,)."""
    centres = mesh.corners_mm.mean(axis=1)
    for _ in range(_ITERATIONS):
        value, slope = field(centres)
        centres -= (value / (slope**2).sum(axis=1))[:, None] * slope
    normals = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    return centres, normals, np.linalg.norm(mesh.area_vectors_mm2, axis=1)


def open_triangles(mesh: TriangleMesh) -> np.ndarray:
    """True (f,) for triangles with a corner on an open edge of the mesh."""
    on_edge = np.zeros(len(mesh.vertices_mm), dtype=bool)
    on_edge[mesh.boundary_edges.ravel()] = True
    return on_edge[mesh.faces].any(axis=1)
