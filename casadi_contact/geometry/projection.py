"""Projections of a fixed surface onto a plane (u, v) [mm], along parallel lines or from the middle of a cup; and
elements on the smooth surface of a fixed mesh: a structured grid laid over it by a projection, or its triangles.

A point of the plane stands for the line p(h) = s(u, v) + h·e(u, v) with the unit vector e, which points to where the
moving body comes from; the surface is what a ray against e meets first. Lines of a central projection all begin at the
middle of a cup, s, and h = -r; a sphere of radius R about it is laid out about its pole so that areas keep their size
(Lambert's azimuthal map): u² + v² = (2R·sin(θ/2))² at the angle θ from the pole.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, field_parts
from casadi_contact.geometry.elements import CellGrid
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh, beside_creases

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
    remedy = "turn it to the moving body with geometry.axes, or set geometry.pressing"

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
        centre = f"geometry.cup_centre = {centre_mm.tolist()}"
        raise ValueError(f"mesh {mesh.name}: none of it faces {centre}, {CentralProjection.remedy}")
    return np.asarray(corners[faces].reshape(-1, 3))


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
) -> CellGrid:
    """Centres (nx, nz, 3), unit normals (nx, nz, 3) and areas (nx, nz) of equal cells in u and v, inside the box.

    A ray along the line of each cell's middle finds the mesh, and Newton's method along it the smooth surface, whose
    normal gives the area dA = du·dv·spread/cos(normal, line). A field rounds off creases: within ``rounded_nodes`` of
    its spacing beside a crease, cells lie on the smooth surface itself, made by `surface`. Cells whose ray misses
    the mesh or meets a wall have no area, nor have those whose smooth surface lies farther from the triangle than
    step_mm and step_share of its longest edge (how far a coarse sphere bulges). Raises ValueError if no cell is left.
    """
    low, high, top = projection.bounds(mesh, box)
    step = (high - low) / grid
    u, v = (low[axis] + (np.arange(count) + 0.5) * step[axis] for axis, count in enumerate(grid))
    lines = projection.lines(*(values.ravel() for values in np.meshgrid(u, v, indexing="ij")))
    up, seen_from, remedy = lines.ups, projection.seen_from, projection.remedy
    tops, down = lines.starts + top * up, -up
    caster = RayCaster(mesh)
    distance, face = caster.first_hits(tops, down)
    if not (face >= 0).any():
        raise ValueError(f"mesh {mesh.name}: no ray from {seen_from} meets it on a {grid[0]}×{grid[1]} grid: {remedy}")
    if caster.leaves(down, face).sum() > 0.5 * (face >= 0).sum():
        raise ValueError(f"mesh {mesh.name} shows its inside to {seen_from}, expected its outside: {remedy}")
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


def triangles_on_mesh(mesh: TriangleMesh, field: DistanceField, iterations: int = 6) -> tuple[Array, Array, Array]:
    """Each triangle's centre (f, 3) moved onto the smooth surface, the normal there (f, 3) and its flat area (f,)."""
    centres = mesh.corners_mm.mean(axis=1)
    for _ in range(iterations):
        value, gradient = field(centres)
        centres -= (value / (gradient**2).sum(axis=1))[:, None] * gradient
    normals = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    return centres, normals, mesh.areas_mm2
