"""The elastic foundation's inner loops, compiled by numba and run over poses; other threads run meanwhile.

An element at c with outward normal n meets the moving body if c lies inside it (g(c) < 0); its depth d is the
distance from c along -n to the body's surface, by Newton's method on g(c - d·n) = 0. Its load is -p(d)·A·(n, c × n).

Points are stored coordinate after coordinate (3, m), so that loops over them run in vectors; boxes likewise (12, b).
"""

from typing import Any

import numpy as np

from casadi_contact.contact.pressure_law import pressure
from casadi_contact.core.compilation import njit
from casadi_contact.geometry.distance_field import CURVATURE_REACH_MM, field_curvature
from casadi_contact.geometry.moving_surface import MESH_FIELD, NUMBERS_PER_ARC, SWEPT_ARCS
from casadi_contact.geometry.surface_distances import signed_distance

STEEPEST_FIELD = 1.1  # slope of a mesh's distance field: 1, and what its spline overshoots at sharp edges
_VECTORS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz", "arcp", "reassoc"}}  # sums in any order


@njit(inline="always")
def to_moving(R, t, x, y, z):
    """q = Rᵀ(p - t)."""
    x -= t[0]
    y -= t[1]
    z -= t[2]
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@njit(inline="always")
def to_fixed(R, x, y, z):
    """R·w."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(inline="always")
def _square_reach(boxes, b):
    """|r|² of the corners of the box about block b: the sum of its half axes' squares."""
    total = 0.0
    for k in range(3, 12):
        total += boxes[k, b] ** 2
    return total


@njit(**_VECTORS)
def _swept_distances(parameters, points, R, t):
    """As `_distances`, of swept arcs: `signed_distance` of all points at once."""
    count = points.shape[1]
    found, (qx, qy, qz) = np.empty((4, count)), np.empty((3, count))
    g, x, y, offset = found
    last = 3 + NUMBERS_PER_ARC * (int(parameters[0]) - 1)
    end_x, end_y, end_offset = parameters[last], parameters[last + 1], parameters[last + 2]
    for e in range(count):
        qx[e], qy[e], qz[e] = to_moving(R, t, points[0, e], points[1, e], points[2, e])
        x[e], y[e], offset[e] = end_x, end_y, end_offset
    for at in range(last - NUMBERS_PER_ARC, 0, -NUMBERS_PER_ARC):
        axis_x, axis_y, out, along_x, along_y = parameters[at : at + NUMBERS_PER_ARC]
        for e in range(count):
            past = (qx[e] - axis_x) * along_x + (qy[e] - axis_y) * along_y > 0.0
            x[e], y[e], offset[e] = x[e] if past else axis_x, y[e] if past else axis_y, offset[e] if past else out
    for e in range(count):
        dx, dy, dz = qx[e] - x[e], qy[e] - y[e], qz[e] - parameters[2]
        rho = max(np.sqrt(dx * dx + dy * dy), 1e-12)
        out = rho - offset[e]
        distance = max(np.sqrt(out * out + dz * dz), 1e-12)
        scale = out / (distance * rho)
        g[e] = distance - parameters[1]
        x[e], y[e], offset[e] = to_fixed(R, scale * dx, scale * dy, dz / distance)
    return found


@njit(**_VECTORS)
def _distances(family, parameters, points, R, t):
    """g and its gradient G (fixed frame) (4, n) at points (3, n) of the fixed frame, the body in one pose."""
    if family == SWEPT_ARCS:
        return _swept_distances(parameters, points, R, t)
    found = np.empty((4, points.shape[1]))
    for e in range(points.shape[1]):
        qx, qy, qz = to_moving(R, t, points[0, e], points[1, e], points[2, e])
        found[0, e], ax, ay, az = signed_distance(family, parameters, qx, qy, qz)
        found[1, e], found[2, e], found[3, e] = to_fixed(R, ax, ay, az)
    return found


@njit(**_VECTORS)
def point_distances(family, parameters, points, R, t):
    """g of points (3, m) of the fixed frame from the moving body in one pose [mm]."""
    if family != MESH_FIELD:
        return _distances(family, parameters, points, R, t)[0]
    distances = np.empty(points.shape[1])
    for k in range(len(distances)):
        qx, qy, qz = to_moving(R, t, points[0, k], points[1, k], points[2, k])
        distances[k] = signed_distance(family, parameters, qx, qy, qz)[0]
    return distances


@njit(**_VECTORS)
def _tangents(family, parameters, R, t, boxes):
    """g and its gradient G (fixed frame) at the middles c of blocks, and bounds M on its curvature there (5, b).

    Where g_c + G·(p - c) - M|p - c|²/2 > 0 the point p of the block lies outside the body. M = 0 for the analytic
    families, which are convex; see `geometry.distance_field` for a mesh. (An infinite M excludes nothing.)
    """
    count = boxes.shape[1]
    tangents = np.zeros((5, count))
    tangents[:4] = _distances(family, parameters, boxes[:3], R, t)
    if family == MESH_FIELD:
        for b in range(count):
            qx, qy, qz = to_moving(R, t, boxes[0, b], boxes[1, b], boxes[2, b])
            near = _square_reach(boxes, b) < CURVATURE_REACH_MM**2
            tangents[4, b] = field_curvature(parameters, qx, qy, qz) if near else np.inf
    return tangents


@njit(**_VECTORS)
def block_bounds(family, tangents, boxes):
    """Least g (b,) that any point of each block can have: by its tangent at the centre, where g is convex; for a mesh
    by its tangent and curvature if these say that the block lies outside, else by its slope."""
    bounds = np.empty(boxes.shape[1])
    for b in range(len(bounds)):
        gx, gy, gz = tangents[1, b], tangents[2, b], tangents[3, b]
        bounds[b] = tangents[0, b]
        for k in (3, 6, 9):
            bounds[b] -= abs(gx * boxes[k, b] + gy * boxes[k + 1, b] + gz * boxes[k + 2, b])
    for b in range(len(bounds) if family == MESH_FIELD else 0):
        reach2, curvature = _square_reach(boxes, b), tangents[4, b]
        if curvature < np.inf:
            bounds[b] -= 0.5 * curvature * reach2
        if bounds[b] <= 0.0 or curvature == np.inf:
            bounds[b] = tangents[0, b] - STEEPEST_FIELD * np.sqrt(reach2)
    return bounds


@njit(inline="always")
def point_bound(tangent, dx, dy, dz):
    """Positive only if the point at offset (dx, dy, dz) from a block's centre lies outside the body."""
    g, gx, gy, gz, curvature = tangent
    return g + gx * dx + gy * dy + gz * dz - 0.5 * curvature * (dx * dx + dy * dy + dz * dz)


RAY_ITERATIONS = 30
RAY_TOLERANCE_MM = 1e-5  # of the last step: Newton's method squares it, so that the next would be below 1e-9
NEAREST_SURFACE = 0.9  # of -g(c): g rises by 1 over 1 mm, the field of a mesh by a little more at sharp edges
STEEPEST_RAY_SLOPE = -0.05  # cos of the angle between ray and surface: flatter rays are cut off here


@njit(**_VECTORS)
def near_elements(family, parameters, elements, R, t):
    """Numbers (k,) of the elements of blocks that the body may meet, those that it may lie over."""
    centres, _, _, blocks, boxes = elements
    tangents = _tangents(family, parameters, R, t, boxes)
    bounds = block_bounds(family, tangents, boxes)
    found, count = np.empty(centres.shape[1], np.int64), 0
    for b in range(len(bounds)):
        if bounds[b] > 0.0:
            continue
        tangent = tangents[:, b]
        for e in range(blocks[b], blocks[b + 1]):
            dx, dy, dz = centres[0, e] - boxes[0, b], centres[1, e] - boxes[1, b], centres[2, e] - boxes[2, b]
            found[count] = e
            count += point_bound(tangent, dx, dy, dz) < 0.0
    return found[:count]


@njit(**_VECTORS)
def overlap_many(family, parameters, points, normals, R, t, reach):
    """Signed depths (m,) [mm] of points (3, m) along -n in one pose, below 0 outside of the moving body, and their
    derivatives by its twist about t (m, 6); -inf for points farther from it than the reach."""
    overlaps, slopes = np.full(points.shape[1], -np.inf), np.zeros((6, points.shape[1]))
    outside = point_distances(family, parameters, points, R, t)
    active = np.flatnonzero(outside < reach)
    # Newton's method would diverge without the bound 0.9·start, or start/0.05 from outside, where g jumps.
    start = -outside
    overlaps[active] = start[active]
    for _ in range(RAY_ITERATIONS):
        count = 0
        ends = np.empty((3, len(active)))
        for k, e in enumerate(active):
            for i in range(3):
                ends[i, k] = points[i, e] - overlaps[e] * normals[i, e]
        found = _distances(family, parameters, ends, R, t)
        for k, e in enumerate(active):
            gx, gy, gz = found[1, k], found[2, k], found[3, k]
            slope = min(gx * normals[0, e] + gy * normals[1, e] + gz * normals[2, e], STEEPEST_RAY_SLOPE)
            least = NEAREST_SURFACE * start[e] if start[e] > 0.0 else -start[e] / STEEPEST_RAY_SLOPE
            d = max(overlaps[e] + found[0, k] / slope, least)
            moved, overlaps[e] = abs(d - overlaps[e]), d
            slopes[0, e], slopes[1, e], slopes[2, e] = -gx / slope, -gy / slope, -gz / slope
            active[count] = e
            count += moved >= RAY_TOLERANCE_MM
        active = active[:count]
        if not count:
            break
    for k in range(len(overlaps)):
        d = overlaps[k] if np.isfinite(overlaps[k]) else 0.0
        x, y, z = points[0, k] - t[0], points[1, k] - t[1], points[2, k] - t[2]
        x, y, z = x - d * normals[0, k], y - d * normals[1, k], z - d * normals[2, k]
        fx, fy, fz = slopes[0, k], slopes[1, k], slopes[2, k]
        slopes[3, k], slopes[4, k], slopes[5, k] = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
        if outside[k] >= 0.0:
            overlaps[k] = min(overlaps[k], 0.0)
    return overlaps, slopes.T


@njit(**_VECTORS)
def _patch_wrench(family, parameters, elements, law, modulus, thickness, R, t, wrench, stiffness, derivatives):
    """Add up one patch's wrench (6,) and, if asked, d wrench / d twist of the moving body about t (6, 6)."""
    centres, normals, areas, _, _ = elements
    near = near_elements(family, parameters, elements, R, t)
    points, along = np.empty((3, len(near))), np.empty((3, len(near)))
    for i in range(3):
        for k, e in enumerate(near):
            points[i, k], along[i, k] = centres[i, e], normals[i, e]
    depths, slopes = overlap_many(family, parameters, points, along, R, t, 0.0)
    loads, forces, rises = np.empty((6, len(near))), np.zeros(len(near)), np.zeros(len(near))
    for k, e in enumerate(near):
        if depths[k] > 0.0:
            p, dp, _ = pressure(law, modulus, thickness[e], depths[k])
            forces[k], rises[k] = -p * areas[e], -dp * areas[e]
    for k in range(len(near)):
        cx, cy, cz, nx, ny, nz = points[0, k], points[1, k], points[2, k], along[0, k], along[1, k], along[2, k]
        loads[0, k], loads[1, k], loads[2, k] = nx, ny, nz
        loads[3, k], loads[4, k], loads[5, k] = cy * nz - cz * ny, cz * nx - cx * nz, cx * ny - cy * nx
    for i in range(6):
        total = 0.0
        for k in range(len(near)):
            total += forces[k] * loads[i, k]
        wrench[i] = total
    for i in range(6 if derivatives else 0):
        for j in range(6):
            total = 0.0
            for k in range(len(near)):
                total += rises[k] * loads[i, k] * slopes[k, j]
            stiffness[i, j] = total


@njit(**_VECTORS)
def _patch_gap(family, parameters, elements, R, t, slope):
    """Smallest g over the elements, and its derivative by the twist of the moving body about t (6,)."""
    centres, _, _, blocks, boxes = elements
    tangents = _tangents(family, parameters, R, t, boxes)
    bounds = block_bounds(family, tangents, boxes)
    best, nearest, first = np.inf, -1, np.argmin(bounds)
    for turn in range(-1, len(bounds)):
        b = first if turn < 0 else turn
        if bounds[b] >= best:
            continue
        tangent = tangents[:, b]
        for e in range(blocks[b], blocks[b + 1]):
            dx, dy, dz = centres[0, e] - boxes[0, b], centres[1, e] - boxes[1, b], centres[2, e] - boxes[2, b]
            if point_bound(tangent, dx, dy, dz) >= max(best, 0.0):
                continue
            qx, qy, qz = to_moving(R, t, centres[0, e], centres[1, e], centres[2, e])
            g = signed_distance(family, parameters, qx, qy, qz)[0]
            if g < best:
                best = g
                nearest = e
    c = np.empty((3, 1))
    c[:, 0] = centres[:, nearest]
    _, gx, gy, gz = _distances(family, parameters, c, R, t)[:, 0]
    x, y, z = c[0, 0] - t[0], c[1, 0] - t[1], c[2, 0] - t[2]
    slope[:] = (-gx, -gy, -gz, z * gy - y * gz, x * gz - z * gx, y * gx - x * gy)
    return best


@njit(nogil=True)
def wrench_many(family, parameters, elements, law, modulus, thickness, derivatives, rotations, translations):
    """Wrenches (n, 6) and stiffnesses d wrench / d twist (n, 6, 6) of one patch; thickness (m,): under each element."""
    count = len(translations)
    wrenches = np.empty((count, 6))
    stiffnesses = np.empty((count if derivatives else 0, 6, 6))
    for k in range(count):
        stiffness, R, t = np.empty((6, 6)), rotations[k], translations[k]
        _patch_wrench(family, parameters, elements, law, modulus, thickness, R, t, wrenches[k], stiffness, derivatives)
        if derivatives:
            stiffnesses[k] = stiffness
    return wrenches, stiffnesses


@njit(nogil=True)
def gap_many(family, parameters, elements, rotations, translations):
    """Gaps (n,) of one patch and their derivatives by twist (n, 6) for n poses."""
    count = len(translations)
    gaps = np.empty(count)
    slopes = np.empty((count, 6))
    for k in range(count):
        gaps[k] = _patch_gap(family, parameters, elements, rotations[k], translations[k], slopes[k])
    return gaps, slopes
