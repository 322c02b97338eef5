"""Elements on the smooth surface of a fixed mesh: a structured grid laid over it from above, or its triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, field_parts
from casadi_contact.geometry.elements import Cells
from casadi_contact.geometry.projection import LEAST_UPWARD, ParallelProjection, Projection, axis_name
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh, beside_creases


def grid_on_mesh(
    mesh: TriangleMesh,
    field: DistanceField,
    grid: tuple[int, int],
    box: tuple[Array, Array],
    projection: Projection,
    surface: Callable[[], SmoothSurface],
    *,
    rounded_nodes: float = 2.0,
    step_mm: float = 0.5,
    step_share: float = 0.15,
) -> Cells:
    """Centres (nx, nz, 3), unit normals (nx, nz, 3) and areas (nx, nz) of equal cells in u and v, inside the box.

    A ray along the line of each cell's middle finds the mesh, and Newton's method along it the smooth surface, whose
    normal gives the area dA = du·dv·spread/cos(normal, line). A field rounds off creases: within ``rounded_nodes`` of
    its spacing beside a crease, cells lie on the smooth surface itself, made by `surface`. Cells whose ray misses the
    mesh or meets a wall have no area, nor have those whose smooth surface lies farther from the triangle than step_mm
    and step_share of its longest edge (how far a coarse sphere bulges). Raises ValueError if no cell is left.
    """
    low, high, top = projection.bounds(mesh, box)
    step = (high - low) / grid
    u, v = (low[axis] + (np.arange(count) + 0.5) * step[axis] for axis, count in enumerate(grid))
    lines = projection.lines(*(values.ravel() for values in np.meshgrid(u, v, indexing="ij")))
    up, seen_from, remedy = lines.ups, projection.seen_from, _remedy(mesh, projection)
    tops, down = lines.starts + top * up, -up
    caster = RayCaster(mesh)
    distance, face = caster.first_hits(tops, down)
    if not (face >= 0).any():
        raise ValueError(f"mesh {mesh.name}: no ray from {seen_from} meets it on a {grid[0]}×{grid[1]} grid: {remedy}")
    if caster.leaves(down, face).sum() > 0.5 * (face >= 0).sum():
        raise ValueError(
            f"mesh {mesh.name} shows its inside to {seen_from}, expected the outside of the surface: {remedy}"
        )
    met = np.flatnonzero(np.isfinite(distance) & ~caster.leaves(down, face))
    centres, normals, areas = tops.copy(), up.copy(), np.zeros(len(tops))
    h, along = top - distance[met], up[met]
    flat = lines.starts[met] + h[:, None] * along
    h, on, normal = _on_field(field, lines.starts[met], along, h)
    bears = np.einsum("nk,nk->n", mesh.normals[face[met]], along) > LEAST_UPWARD
    rounded = beside_creases(mesh, flat, face[met[bears]], rounded_nodes * field_parts(field.parameters)[1])
    if len(rounded):
        on[rounded], normal[rounded] = surface().along_lines(flat[rounded], along[rounded])
        h = np.einsum("nk,nk->n", on - lines.starts[met], along)
    upward = np.einsum("nk,nk->n", normal, along)
    corners = mesh.corners_mm[face[met]]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    largest_step = np.maximum(step_mm, step_share * longest)
    kept = (upward > LEAST_UPWARD) & (np.linalg.norm(on - flat, axis=1) * upward < largest_step)
    kept &= np.all((on >= box[0]) & (on < box[1]), axis=1)
    centres[met[kept]], normals[met[kept]] = on[kept], normal[kept]
    areas[met[kept]] = step.prod() * projection.spread(h[kept]) / upward[kept]
    if not kept.any():
        raise ValueError(f"mesh {mesh.name}: all it shows to {seen_from} is steeper than 78 degrees: {remedy}")
    return centres.reshape(*grid, 3), normals.reshape(*grid, 3), areas.reshape(grid)


def _on_field(
    field: DistanceField, starts: Array, along: Array, h: Array, iterations: int = 6
) -> tuple[Array, Array, Array]:
    """The zero h (m,) [mm] of the field along unit directions (m, 3) from starts (m, 3), the points there (m, 3) and
    the field's unit normals (m, 3), by Newton's method from the given h."""
    h, on = h.copy(), starts + h[:, None] * along
    for _ in range(iterations):
        value, gradient = field(on)
        h -= value / np.maximum(np.einsum("nk,nk->n", gradient, along), LEAST_UPWARD)
        on = starts + h[:, None] * along
    return h, on, gradient / np.linalg.norm(gradient, axis=1, keepdims=True)


def _remedy(mesh: TriangleMesh, projection: Projection, least_share: float = 0.3) -> str:
    """What to do where rays meet no outside: the mesh's net area vector, of a closed body 0, of a half-sphere half of
    its area, tells where it faces if it is more than a share of the area."""
    area = mesh.area_vectors_mm2
    net = area.sum(axis=0)
    faces_nowhere = np.linalg.norm(net) <= least_share * np.linalg.norm(area, axis=1).sum()
    if faces_nowhere or not isinstance(projection, ParallelProjection):
        return projection.remedy
    facing = axis_name(net)
    return f"its surface faces {facing}: turn it to the moving body with geometry.axes, or set geometry.pressing"


def triangles_on_mesh(mesh: TriangleMesh, field: DistanceField, iterations: int = 6) -> tuple[Array, Array, Array]:
    """Each triangle's centre (f, 3) moved onto the smooth surface, the normal there (f, 3) and its flat area (f,)."""
    centres = mesh.corners_mm.mean(axis=1)
    for _ in range(iterations):
        value, gradient = field(centres)
        centres -= (value / (gradient**2).sum(axis=1))[:, None] * gradient
    normals = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    return centres, normals, mesh.areas_mm2


def open_triangles(mesh: TriangleMesh) -> np.ndarray:
    """True (f,) for triangles with a corner on an open edge of the mesh."""
    on_edge = np.zeros(len(mesh.vertices_mm), dtype=bool)
    on_edge[mesh.boundary_edges.ravel()] = True
    return on_edge[mesh.faces].any(axis=1)
