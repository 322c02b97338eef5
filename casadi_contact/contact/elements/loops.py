"""The elastic foundation's inner loops, compiled by numba and run over poses; other threads run meanwhile.

An element at c with outward normal n meets the moving body if c lies inside it (g(c) < 0); its depth d is the
distance from c along -n to the body's surface, found by Newton's method on g(c - d·n) = 0. Its load on the fixed
body is -p(d)·A·(n, c × n).
"""

import numpy as np

from casadi_contact.contact.pressure_law import pressure
from casadi_contact.core.compilation import njit
from casadi_contact.geometry.distance_field import CURVATURE_REACH_MM, field_curvature
from casadi_contact.geometry.moving_surface import MESH_FIELD
from casadi_contact.geometry.surface_distances import signed_distance, signed_distance_value

STEEPEST_FIELD = 1.1  # slope of a mesh's distance field: 1, and what its spline overshoots at sharp edges


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
        total += boxes[b, k] ** 2
    return total


@njit(inline="always")
def tangent_at(family, parameters, R, t, boxes, b):
    """g and its gradient G (fixed frame) at the centre c of block b, and a bound M on its curvature over the block.

    Where g_c + G·(p - c) - M|p - c|²/2 > 0 the point p of the block lies outside the body. M = 0 for the analytic
    families, which are convex; see `geometry.distance_field` for a mesh. (An infinite M excludes nothing.)
    """
    qx, qy, qz = to_moving(R, t, boxes[b, 0], boxes[b, 1], boxes[b, 2])
    g, ax, ay, az = signed_distance(family, parameters, qx, qy, qz)
    curvature = 0.0
    if family == MESH_FIELD:
        near = _square_reach(boxes, b) < CURVATURE_REACH_MM**2
        curvature = field_curvature(parameters, qx, qy, qz) if near else np.inf
    gx, gy, gz = to_fixed(R, ax, ay, az)
    return g, gx, gy, gz, curvature


@njit(inline="always")
def block_bound(family, tangent, boxes, b):
    """Least g that any point of block b can have: by its tangent at the centre, where g is convex; for a
    mesh by its tangent and curvature if these say that the block lies outside, else by its slope."""
    g, gx, gy, gz, curvature = tangent
    bound = g
    for k in (3, 6, 9):
        bound -= abs(gx * boxes[b, k] + gy * boxes[b, k + 1] + gz * boxes[b, k + 2])
    if family == MESH_FIELD:
        reach2 = _square_reach(boxes, b)
        if curvature < np.inf:
            bound -= 0.5 * curvature * reach2
        if bound <= 0.0 or curvature == np.inf:
            bound = g - STEEPEST_FIELD * np.sqrt(reach2)
    return bound


@njit(inline="always")
def point_bound(tangent, dx, dy, dz):
    """Positive only if the point at offset (dx, dy, dz) from a block's centre lies outside the body."""
    g, gx, gy, gz, curvature = tangent
    return g + gx * dx + gy * dy + gz * dz - 0.5 * curvature * (dx * dx + dy * dy + dz * dz)


@njit(inline="always")
def _set_twist(out, scale, fx, fy, fz, x, y, z):
    """scale·(f, p × f) (6,): what a force f at p does to the velocities of a twist."""
    out[0], out[1], out[2] = scale * fx, scale * fy, scale * fz
    out[3] = scale * (y * fz - z * fy)
    out[4] = scale * (z * fx - x * fz)
    out[5] = scale * (x * fy - y * fx)


RAY_ITERATIONS = 30
RAY_TOLERANCE_MM = 1e-5  # of the last step: Newton's method squares it, so that the next would be below 1e-9
NEAREST_SURFACE = 0.9  # of -g(c): g rises by 1 over 1 mm, the field of a mesh by a little more at sharp edges
STEEPEST_RAY_SLOPE = -0.05  # cos of the angle between ray and surface: flatter rays are cut off here


@njit(inline="always")
def _depth(family, parameters, R, t, cx, cy, cz, nx, ny, nz, start):
    """Depth d along -n, below 0 for a point outside, and the surface gradient G (fixed frame) there; start = -g(c)."""
    d = start  # below: without this bound Newton's method diverges where g jumps
    least = NEAREST_SURFACE * start if start > 0.0 else -start / STEEPEST_RAY_SLOPE
    gx = gy = gz = 0.0
    for _ in range(RAY_ITERATIONS):
        qx, qy, qz = to_moving(R, t, cx - d * nx, cy - d * ny, cz - d * nz)
        g, ax, ay, az = signed_distance(family, parameters, qx, qy, qz)
        gx, gy, gz = to_fixed(R, ax, ay, az)
        slope = min(gx * nx + gy * ny + gz * nz, STEEPEST_RAY_SLOPE)
        before, d = d, max(d + g / slope, least)
        if abs(d - before) < RAY_TOLERANCE_MM:
            break
    return d, gx, gy, gz


@njit()
def _patch_wrench(family, parameters, elements, law, modulus, thickness, R, t, wrench, stiffness, derivatives):
    """Add up one patch's wrench (6,) and, if asked, d wrench / d twist of the moving body about t (6, 6)."""
    centres, normals, areas, blocks, boxes = elements
    wrench[:] = 0.0
    stiffness[:] = 0.0
    load_direction = np.empty(6)
    depth_slope = np.empty(6)
    for b in range(len(boxes)):
        tangent = tangent_at(family, parameters, R, t, boxes, b)
        if block_bound(family, tangent, boxes, b) > 0.0:
            continue
        bx, by, bz = boxes[b, 0], boxes[b, 1], boxes[b, 2]
        for e in range(blocks[b], blocks[b + 1]):
            cx, cy, cz = centres[e, 0], centres[e, 1], centres[e, 2]
            if point_bound(tangent, cx - bx, cy - by, cz - bz) >= 0.0:
                continue
            qx, qy, qz = to_moving(R, t, cx, cy, cz)
            g = signed_distance_value(family, parameters, qx, qy, qz)
            if g >= 0.0:
                continue
            nx, ny, nz = normals[e, 0], normals[e, 1], normals[e, 2]
            d, gx, gy, gz = _depth(family, parameters, R, t, cx, cy, cz, nx, ny, nz, -g)
            p, dp, _ = pressure(law, modulus, thickness[e], d)
            _set_twist(load_direction, -1.0, nx, ny, nz, cx, cy, cz)
            force = p * areas[e]
            for i in range(6):
                wrench[i] += force * load_direction[i]
            if derivatives:
                # g(p) = 0 at p = c - d·n moves with the body: dd/dt = -G/(G·n), dd/dω = -((p - t) × G)/(G·n).
                rx, ry, rz = cx - d * nx - t[0], cy - d * ny - t[1], cz - d * nz - t[2]
                scale = -dp * areas[e] / min(gx * nx + gy * ny + gz * nz, STEEPEST_RAY_SLOPE)
                _set_twist(depth_slope, scale, gx, gy, gz, rx, ry, rz)
                for i in range(6):
                    for j in range(6):
                        stiffness[i, j] += load_direction[i] * depth_slope[j]


@njit()
def _patch_gap(family, parameters, elements, R, t, slope):
    """Smallest g over the elements, and its derivative by the twist of the moving body about t (6,)."""
    centres, _, _, blocks, boxes = elements
    bounds = np.empty(len(boxes))
    for b in range(len(boxes)):
        bounds[b] = block_bound(family, tangent_at(family, parameters, R, t, boxes, b), boxes, b)
    best = np.inf
    nearest = -1
    for b in np.argsort(bounds):
        if bounds[b] >= best:
            break
        for e in range(blocks[b], blocks[b + 1]):
            qx, qy, qz = to_moving(R, t, centres[e, 0], centres[e, 1], centres[e, 2])
            g = signed_distance_value(family, parameters, qx, qy, qz)
            if g < best:
                best = g
                nearest = e
    c = centres[nearest]
    qx, qy, qz = to_moving(R, t, c[0], c[1], c[2])
    g, ax, ay, az = signed_distance(family, parameters, qx, qy, qz)
    gx, gy, gz = to_fixed(R, ax, ay, az)
    _set_twist(slope, -1.0, gx, gy, gz, c[0] - t[0], c[1] - t[1], c[2] - t[2])
    return best


@njit()
def near_elements(family, parameters, elements, R, t):
    """Numbers (k,) of the elements of blocks that the body may meet, those that it may lie over."""
    centres, _, _, blocks, boxes = elements
    found, count = np.empty(len(centres), np.int64), 0
    for b in range(len(boxes)):
        tangent = tangent_at(family, parameters, R, t, boxes, b)
        if block_bound(family, tangent, boxes, b) > 0.0:
            continue
        for e in range(blocks[b], blocks[b + 1]):
            dx, dy, dz = centres[e, 0] - boxes[b, 0], centres[e, 1] - boxes[b, 1], centres[e, 2] - boxes[b, 2]
            found[count] = e
            count += point_bound(tangent, dx, dy, dz) < 0.0
    return found[:count]


@njit(nogil=True)
def wrench_many(family, parameters, elements, law, modulus, thickness, derivatives, rotations, translations):
    """Wrenches (n, 6) and stiffnesses d wrench / d twist (n, 6, 6) of one patch for n poses; thickness (m,): under each
    element."""
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


@njit()
def point_distances(family, parameters, points, R, t):
    """g of points (m, 3) of the fixed frame from the moving body in one pose [mm]."""
    distances = np.empty(len(points))
    for k in range(len(points)):
        qx, qy, qz = to_moving(R, t, points[k, 0], points[k, 1], points[k, 2])
        distances[k] = signed_distance_value(family, parameters, qx, qy, qz)
    return distances


@njit()
def overlap_many(family, parameters, points, normals, R, t, reach):
    """Signed depths (m,) [mm] of points along -n in one pose, below 0 outside of the moving body, and the derivatives
    by its twist about t (m, 6); -inf for points farther from it than the reach."""
    overlaps, slopes = np.full(len(points), -np.inf), np.zeros((len(points), 6))
    for e in range(len(points)):
        cx, cy, cz = points[e, 0], points[e, 1], points[e, 2]
        qx, qy, qz = to_moving(R, t, cx, cy, cz)
        g = signed_distance_value(family, parameters, qx, qy, qz)
        if g < reach:
            nx, ny, nz = normals[e, 0], normals[e, 1], normals[e, 2]
            d, gx, gy, gz = _depth(family, parameters, R, t, cx, cy, cz, nx, ny, nz, -g)
            overlaps[e] = d if g < 0.0 else min(d, 0.0)
            scale = -1.0 / min(gx * nx + gy * ny + gz * nz, STEEPEST_RAY_SLOPE)
            _set_twist(slopes[e], scale, gx, gy, gz, cx - d * nx - t[0], cy - d * ny - t[1], cz - d * nz - t[2])
    return overlaps, slopes
