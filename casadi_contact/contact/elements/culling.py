"""Which elements cannot touch the moving body: bounds on its distance from a block's centre, for numba's loops."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.compilation import njit
from casadi_contact.geometry.distance_field import CURVATURE_REACH_MM, field_curvature
from casadi_contact.geometry.moving_surface import MESH_FIELD
from casadi_contact.geometry.surfaces import signed_distance

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
def tangent_at(family, parameters, R, t, centres, extents, b):
    """g and its gradient G (fixed frame) at the centre c of block b, and a bound M on its curvature over the block.

    Where g_c + G·(p - c) - M|p - c|²/2 > 0 the point p of the block lies outside the body. M = 0 for the analytic
    families, which are convex; see `geometry.distance_field` for a mesh. (An infinite M excludes nothing.)
    """
    qx, qy, qz = to_moving(R, t, centres[b, 0], centres[b, 1], centres[b, 2])
    g, ax, ay, az = signed_distance(family, parameters, qx, qy, qz)
    curvature = 0.0
    if family == MESH_FIELD:
        reach2 = extents[b, 0] ** 2 + extents[b, 1] ** 2 + extents[b, 2] ** 2
        curvature = field_curvature(parameters, qx, qy, qz) if reach2 < CURVATURE_REACH_MM**2 else np.inf
    return (
        g,
        R[0, 0] * ax + R[0, 1] * ay + R[0, 2] * az,
        R[1, 0] * ax + R[1, 1] * ay + R[1, 2] * az,
        R[2, 0] * ax + R[2, 1] * ay + R[2, 2] * az,
        curvature,
    )


@njit(inline="always")
def block_bound(family, tangent, extents, b):
    """Least g that any point of block b (half extents) can have: by its tangent at the centre, where g is convex.

    For a mesh by its tangent and curvature if these say that the block lies outside, else by its slope.
    """
    g, gx, gy, gz, curvature = tangent
    bound = g - abs(gx) * extents[b, 0] - abs(gy) * extents[b, 1] - abs(gz) * extents[b, 2]
    if family == MESH_FIELD:
        reach2 = extents[b, 0] ** 2 + extents[b, 1] ** 2 + extents[b, 2] ** 2
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
