"""A signed distance on a regular grid, interpolated by cubic B-splines: twice continuously differentiable.

g(q) = Σ_ijk c_ijk B(u - i) B(v - j) B(w - k), with (u, v, w) = (q - origin)/spacing and B the cubic B-spline. The
coefficients interpolate the smooth surface's distance (`geometry.smooth_surface`) at every node, or, in a grid finer
than COARSE_MM, at every node near the surface. Outside the grid, which reaches MARGIN_MM beyond the mesh, g is the
value at the nearest grid point plus the distance to it.

Beside the coefficients each node keeps a curvature bound M: the least eigenvalue of ∇²g is at least -M everywhere
within CURVATURE_REACH_MM of the node and outside the body. By Taylor's theorem, while the segment from q to q + δ
stays outside,

    g(q + δ) >= g(q) + ∇g(q)·δ - M|δ|²/2.

If the right side is positive, the segment does stay outside: the right side is a concave function along it, positive
at both ends and so between them. The elastic foundation skips elements by this bound without evaluating g there.
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from casadi_contact.core.compilation import njit
from casadi_contact.core.compiler import cache_folder, is_private
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import replacing
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import TriangleMesh

SPACING_MM, COARSE_MM = 0.75, 1.5
MARGIN_MM = 4.0
CURVATURE_REACH_MM = 2.2
# Nodes at which the curvature bound is taken, by g; those up to 1 mm inside have coefficients that shape g outside.
_BOUNDED_RANGE_MM = (-1.0, 1.2 * CURVATURE_REACH_MM)
_VALUE, _SECOND = np.array([1.0, 4.0, 1.0]) / 6.0, np.array([1.0, -2.0, 1.0])  # of a cubic B-spline at the nodes
_FIRST = np.array([-0.5, 0.0, 0.5])
_HEAD = 7  # numbers before the coefficients: origin x, y, z; spacing; nodes along x, y, z


@dataclass(frozen=True)
class FieldFit:
    """How far a mesh's vertices lie from the smooth surface made of them [mm]."""

    rms_mm: float
    largest_mm: float
    dropped_triangles: int
    nonmanifold_edges: int  # away from contact

    def __str__(self) -> str:
        left = f", {self.nonmanifold_edges} non-manifold edges away from contact" if self.nonmanifold_edges else ""
        return (
            f"smooth surface {self.rms_mm:.2g} mm RMS, {self.largest_mm:.2g} mm at most from the vertices, "
            f"{self.dropped_triangles} degenerate or repeated triangles dropped{left}"
        )


@dataclass(frozen=True, eq=False)
class DistanceField:
    """The grid's numbers as the kernels read them (one flat array), and how well it fits the mesh."""

    parameters: Array
    fit: FieldFit

    def __call__(self, points_mm: Array) -> tuple[Array, Array]:
        """Distances (n,) [mm] and gradients (n, 3) at points (n, 3)."""
        values = field_distances(self.parameters, np.ascontiguousarray(points_mm, dtype=float))
        return values[:, 0], values[:, 1:]


def kept_field(
    mesh: TriangleMesh,
    spacing_mm: float,
    surface: Callable[[], SmoothSurface],
    *,
    least_bytes: int = 4_000_000,
    most_bytes: int = 4_000_000_000,
) -> DistanceField:
    """`build_field`, kept in the cache folder, since a fine one takes half a minute.

    A file begins with the SHA-256 of its numbers, and a damaged one is made anew. Its name is the digest of the mesh,
    the spacing and this room's code. Fields below least_bytes are not kept. The oldest are deleted where all together
    exceed most_bytes."""
    digest = hashlib.sha256(repr((spacing_mm, mesh.dropped)).encode())
    for array in (mesh.vertices_mm, mesh.faces, mesh.slivers):
        digest.update(np.ascontiguousarray(array).data)
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    folder = cache_folder()
    path = folder / f"field-{digest.hexdigest()[:32]}.bin"
    with suppress(OSError, ValueError):
        numbers = np.fromfile(path) if is_private(path) else np.empty(0)
        if hashlib.sha256(numbers[4:].data).digest() == numbers[:4].tobytes():
            rms, largest, dropped, edges = numbers[4:8]
            return DistanceField(numbers[8:], FieldFit(rms, largest, int(dropped), int(edges)))
    field = build_field(mesh, spacing_mm, surface())
    if field.parameters.nbytes >= least_bytes:
        numbers = np.concatenate([astuple(field.fit), field.parameters])
        with suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with replacing(path) as beside, beside.open("wb") as file:
                file.write(hashlib.sha256(numbers.data).digest())
                numbers.tofile(file)
            latest = sorted(folder.glob("field-*.bin"), key=lambda each: -each.stat().st_mtime)
            sizes = np.cumsum([each.stat().st_size for each in latest])
            for each in np.array(latest)[sizes > most_bytes]:
                each.unlink()
    return field


def build_field(
    mesh: TriangleMesh, spacing_mm: float = SPACING_MM, surface: SmoothSurface | None = None
) -> DistanceField:
    """The distance field of a mesh; surface: its smooth surface, made here if left out. Raises ValueError for a grid
    too large for memory."""
    low = mesh.vertices_mm.min(axis=0) - MARGIN_MM
    counts = _node_counts(mesh, spacing_mm)
    if not field_fits(mesh, spacing_mm):
        got = f"a distance field of {spacing_mm:g} mm spacing has {counts.prod()} nodes, too many for memory"
        raise ValueError(f"mesh {mesh.name}: {got}: choose a larger spacing, or cut the mesh to what touches")
    axes = [origin + spacing_mm * np.arange(count) for origin, count in zip(low, counts, strict=True)]
    values = _node_values(surface or SmoothSurface(mesh), axes, spacing_mm)
    coefficients = ndimage.spline_filter(values, order=3, mode="mirror")
    bounded = (values > _BOUNDED_RANGE_MM[0]) & (values < _BOUNDED_RANGE_MM[1])
    bound = _curvature_bound(coefficients, bounded, spacing_mm)
    parameters = np.concatenate([low, [spacing_mm], counts, coefficients.ravel(), bound.ravel()])
    off = field_distances(parameters, mesh.vertices_mm)[:, 0]
    rms, largest = float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())
    return DistanceField(parameters, FieldFit(rms, largest, mesh.dropped, len(mesh.nonmanifold_edges)))


def field_fits(mesh: TriangleMesh, spacing_mm: float, most_nodes: int = 40_000_000) -> bool:
    """Whether a field of this spacing fits into memory: 40 million nodes have 320 MB of coefficients."""
    return bool(_node_counts(mesh, spacing_mm).prod() <= most_nodes)


def _node_counts(mesh: TriangleMesh, spacing_mm: float) -> np.ndarray:
    """Nodes (3,) along x, y and z."""
    size = np.ptp(mesh.vertices_mm, axis=0) + 2.0 * MARGIN_MM
    return np.maximum(np.ceil(size / spacing_mm).astype(int) + 1, 4)  # as many as a cubic takes


def _node_values(surface: SmoothSurface, axes: Sequence[Array], spacing_mm: float, near_nodes: float = 6.0) -> Array:
    """Distances [mm] from the surface at the nodes of a grid by its three axes. A grid finer than COARSE_MM takes the
    distances farther than near_nodes nodes from the surface from the field of twice its spacing: an error in a
    coefficient decays by a factor of 0.27 per node."""
    if spacing_mm < COARSE_MM:
        coarse = build_field(surface.mesh, min(2.0 * spacing_mm, COARSE_MM), surface).parameters
        planes = (np.stack(np.meshgrid(x, *axes[1:], indexing="ij"), axis=-1) for x in axes[0])
        values = np.concatenate([field_distances(coarse, p.reshape(-1, 3))[:, 0].reshape(p.shape[:3]) for p in planes])
    else:
        values = np.zeros([len(axis) for axis in axes])
    near = np.abs(values) < near_nodes * spacing_mm
    points = np.stack([axis[index] for axis, index in zip(axes, np.nonzero(near), strict=True)], axis=1)
    values[near] = surface.distance(points)
    return values


def field_parts(parameters: Array) -> tuple[Array, float, Array, Array]:
    """Origin (3,) and spacing [mm], coefficients and curvature bounds (nx, ny, nz) of a field's parameters."""
    coefficients, bounds = parameters[_HEAD:].reshape(2, *parameters[4:_HEAD].astype(int))
    return parameters[:3], float(parameters[3]), coefficients, bounds


def in_single_precision(parameters: Array) -> Array:
    """A field's parameters with coefficients and bounds rounded to what single precision holds."""
    rounded = parameters.copy()
    rounded[_HEAD:] = parameters[_HEAD:].astype(np.float32)
    return rounded


def _curvature_bound(coefficients: Array, near: np.ndarray, spacing_mm: float) -> Array:
    """M (nx, ny, nz) [1/mm]: the largest -λ_min(∇²g), or 0, of the `near` nodes within reach of each node."""
    count = int(near.sum())
    hessians = np.empty((count, 3, 3))
    for first in range(3):
        for second in range(first, 3):
            part = coefficients
            for axis in range(3):
                times = (axis == first) + (axis == second)
                part = ndimage.correlate1d(part, (_VALUE, _FIRST, _SECOND)[times], axis, mode="mirror")
            hessians[:, first, second] = hessians[:, second, first] = part[near]
    concavity = np.zeros_like(coefficients)
    concavity[near] = np.maximum(-np.linalg.eigvalsh(hessians)[:, 0], 0.0)
    reach = int(np.ceil(CURVATURE_REACH_MM / spacing_mm))
    return ndimage.maximum_filter(concavity, 2 * reach + 1) / spacing_mm**2


@njit(inline="always")
def _weights(t):
    """Cubic B-spline weights of the four nodes around share t of a cell, and their derivatives."""
    s = 1.0 - t
    w = (s * s * s / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0)
    d = (-0.5 * s * s, -2.0 * t + 1.5 * t * t)
    return (
        (w[0], w[1], (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, t * t * t / 6.0),
        (d[0], d[1], 2.0 * s - 1.5 * s * s, 0.5 * t * t),
    )


@njit(inline="always")
def _inside(coordinate, count):
    """Nearest coordinate [nodes] at which all four nodes exist, its first node and its share of the cell."""
    within = min(max(coordinate, 1.0), count - 2.0)
    first = min(int(within), int(count) - 3)
    return within, first - 1, within - first


@njit(inline="always")
def field_distance(parameters, x, y, z):
    """g and its gradient (g, gx, gy, gz) at the point (x, y, z) of the field's frame."""
    spacing = parameters[3]
    scale = 1.0 / spacing
    ny, nz = int(parameters[5]), int(parameters[6])
    px, py, pz = (x - parameters[0]) * scale, (y - parameters[1]) * scale, (z - parameters[2]) * scale
    u, i, tu = _inside(px, parameters[4])
    v, j, tv = _inside(py, parameters[5])
    w, k, tw = _inside(pz, parameters[6])
    wu, du = _weights(tu)
    wv, dv = _weights(tv)
    ww, dw = _weights(tw)
    g = gx = gy = gz = 0.0
    for a in range(4):
        plane = plane_y = plane_z = 0.0
        for b in range(4):
            at = _HEAD + ((i + a) * ny + j + b) * nz + k
            c0, c1, c2, c3 = parameters[at], parameters[at + 1], parameters[at + 2], parameters[at + 3]
            line = c0 * ww[0] + c1 * ww[1] + c2 * ww[2] + c3 * ww[3]
            plane += wv[b] * line
            plane_y += dv[b] * line
            plane_z += wv[b] * (c0 * dw[0] + c1 * dw[1] + c2 * dw[2] + c3 * dw[3])
        g += wu[a] * plane
        gx += du[a] * plane
        gy += wu[a] * plane_y
        gz += wu[a] * plane_z
    gx, gy, gz = gx * scale, gy * scale, gz * scale
    ox, oy, oz = px - u, py - v, pz - w
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        out = np.sqrt(ox * ox + oy * oy + oz * oz)
        g += out * spacing
        gx = ox / out if ox != 0.0 else gx
        gy = oy / out if oy != 0.0 else gy
        gz = oz / out if oz != 0.0 else gz
    return g, gx, gy, gz


@njit()
def field_hessian(parameters, x, y, z):
    """g, its gradient and its second derivatives xx, xy, xz, yy, yz, zz: none along what leaves the grid."""
    derivatives = np.empty(10)
    derivatives[0], derivatives[1], derivatives[2], derivatives[3] = field_distance(parameters, x, y, z)
    scale = 1.0 / parameters[3]
    ny, nz = int(parameters[5]), int(parameters[6])
    px, py, pz = (x - parameters[0]) * scale, (y - parameters[1]) * scale, (z - parameters[2]) * scale
    u, i, tu = _inside(px, parameters[4])
    v, j, tv = _inside(py, parameters[5])
    w, k, tw = _inside(pz, parameters[6])
    weights = np.empty((3, 3, 4))  # axis, order of the derivative, node
    for axis, t in enumerate((tu, tv, tw)):
        values, slopes = _weights(t)
        for a in range(4):
            weights[axis, 0, a], weights[axis, 1, a] = values[a], slopes[a]
        weights[axis, 2] = (1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t)
    derivatives[4:] = 0.0
    for a in range(4):
        for b in range(4):
            at = _HEAD + ((i + a) * ny + j + b) * nz + k
            lines = np.zeros(3)
            for order in range(3):
                for c in range(4):
                    lines[order] += weights[2, order, c] * parameters[at + c]
            wx, wy = weights[0, :, a], weights[1, :, b]
            derivatives[4] += wx[2] * wy[0] * lines[0]
            derivatives[5] += wx[1] * wy[1] * lines[0]
            derivatives[6] += wx[1] * wy[0] * lines[1]
            derivatives[7] += wx[0] * wy[2] * lines[0]
            derivatives[8] += wx[0] * wy[1] * lines[1]
            derivatives[9] += wx[0] * wy[0] * lines[2]
    derivatives[4:] *= scale * scale
    if px != u:
        derivatives[4] = derivatives[5] = derivatives[6] = 0.0
    if py != v:
        derivatives[5] = derivatives[7] = derivatives[8] = 0.0
    if pz != w:
        derivatives[6] = derivatives[8] = derivatives[9] = 0.0
    return derivatives


@njit()
def field_curvature(parameters, x, y, z):
    """The curvature bound M [1/mm] of the node nearest to a point; infinite outside the grid."""
    at = 0
    for axis, coordinate in enumerate((x, y, z)):
        node = (coordinate - parameters[axis]) / parameters[3] + 0.5
        if not 1.0 <= node < parameters[4 + axis] - 1.0:
            return np.inf
        at = at * int(parameters[4 + axis]) + int(node)
    return parameters[_HEAD + (len(parameters) - _HEAD) // 2 + at]


@njit()
def field_distances(parameters, points):
    """`field_distance` of points (n, 3) as rows (n, 4)."""
    values = np.empty((len(points), 4))
    for n in range(len(points)):
        values[n] = field_distance(parameters, points[n, 0], points[n, 1], points[n, 2])
    return values
