"""Elements on the smooth surface of a fixed mesh: a structured grid laid over it from above, or its triangles."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField
from casadi_contact.geometry.elements import Cells
from casadi_contact.geometry.mesh import TriangleMesh
from casadi_contact.geometry.rays import RayCaster

DOWN = (0.0, -1.0, 0.0)
_LEAST_UPWARD = 0.2  # cos of a grid element's normal to the rays: walls steeper than 78 degrees carry none
_LEAST_NET_AREA = 0.3  # of the whole: a closed body has none, a half-sphere half
_ITERATIONS = 6
_LARGEST_STEP_MM = 0.5  # from triangle to smooth surface


def grid_on_mesh(
    mesh: TriangleMesh,
    field: DistanceField,
    grid: tuple[int, int],
    box: tuple[Array, Array],
    pressing: Sequence[float] = DOWN,
) -> Cells:
    """Centres (nx, nz, 3), unit normals (nx, nz, 3) and areas (nx, nz) of equal cells in x and z, inside the box.

    A ray along `pressing` through each cell's centre finds the mesh, Newton's method along it the smooth surface, whose
    normal gives the area dA = dx·dz/cos(normal, ray). A cell whose ray misses the mesh, or meets a wall, has no area.
    Where `pressing` is not -y, its plane has the first and last axis of `grid_frame` instead of x and z. Raises
    ValueError if no cell is left.
    """
    frame = grid_frame(pressing)
    low, high = grid_range(mesh, box, frame)
    step = (high - low)[[0, 2]] / grid
    x, z = (low[axis] + (np.arange(count) + 0.5) * d for axis, count, d in zip((0, 2), grid, step, strict=True))
    points = np.empty((*grid, 3))
    points[..., 0], points[..., 2] = np.meshgrid(x, z, indexing="ij")
    points[..., 1] = high[1] + 1.0
    starts, up = points.reshape(-1, 3) @ frame, frame[1]
    caster, down = RayCaster(mesh), np.tile(-up, (len(starts), 1))
    distance, face = caster.first_hits(starts, down)
    if not (face >= 0).any():
        raise ValueError(
            f"mesh {mesh.name}: no ray along {axis_name(-up)} meets it on a {grid[0]}×{grid[1]} grid: {_cure(mesh)}"
        )
    if caster.leaves(down, face).sum() > 0.5 * (face >= 0).sum():
        raise ValueError(
            f"mesh {mesh.name} shows its inside to {axis_name(up)}, expected the outside of the surface: {_cure(mesh)}"
        )
    met = np.flatnonzero(np.isfinite(distance) & ~caster.leaves(down, face))
    centres, normals, areas = starts.copy(), np.tile(up, (len(starts), 1)), np.zeros(len(starts))
    on = starts[met] + distance[met, None] * down[met]
    flat = on.copy()
    for _ in range(_ITERATIONS):
        value, slope = field(on)
        on -= (value / np.maximum(slope @ up, _LEAST_UPWARD))[:, None] * up
    normal = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    kept = (normal @ up > _LEAST_UPWARD) & (np.linalg.norm(on - flat, axis=1) < _LARGEST_STEP_MM)
    kept &= np.all((on >= box[0]) & (on < box[1]), axis=1)
    centres[met[kept]], normals[met[kept]] = on[kept], normal[kept]
    areas[met[kept]] = step.prod() / (normal[kept] @ up)
    if not kept.any():
        raise ValueError(f"mesh {mesh.name}: all it shows to {axis_name(up)} is steeper than 78 degrees: {_cure(mesh)}")
    return centres.reshape(*grid, 3), normals.reshape(*grid, 3), areas.reshape(grid)


def grid_frame(pressing: Sequence[float]) -> Array:
    """Rows (3, 3): the axis of a grid's first number, that against `pressing`, that of its second number.

    They are x, y, z where `pressing` is -y; the first is as near to x, or to y where that lies along `pressing`, as can
    be.
    """
    up = -np.asarray(pressing, dtype=float) / np.linalg.norm(pressing)
    rough = np.eye(3)[0 if abs(up[0]) < np.sqrt(0.5) else 1]
    first = rough - (rough @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, up, np.cross(first, up)]) + 0.0


def grid_range(mesh: TriangleMesh, box: tuple[Array, Array], frame: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3,) [mm], along the rows of a frame, of what a box may hold of a mesh."""
    low, high = np.maximum(mesh.vertices_mm.min(axis=0), box[0]), np.minimum(mesh.vertices_mm.max(axis=0), box[1])
    corners = np.array(list(itertools.product(*zip(low, high, strict=True)))) @ frame.T
    return corners.min(axis=0), corners.max(axis=0)


def facing_axis(mesh: TriangleMesh) -> str | None:
    """The axis that an open mesh's surface faces on the whole, with its sign ("+z"); None where it faces all ways."""
    area = mesh.area_vectors_mm2
    net = area.sum(axis=0)
    return axis_name(net) if np.linalg.norm(net) > _LEAST_NET_AREA * np.linalg.norm(area, axis=1).sum() else None


def axis_name(direction: Array) -> str:
    """The signed axis nearest to a direction: "-y"."""
    axis = int(np.abs(direction).argmax())
    return f"{'-' if direction[axis] < 0.0 else '+'}{'xyz'[axis]}"


def _cure(mesh: TriangleMesh) -> str:
    facing = facing_axis(mesh)
    if facing is None:
        return "check geometry.axes and geometry.pressing"
    return f"its surface faces {facing}: turn it to the moving body with geometry.axes, or set geometry.pressing"


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
