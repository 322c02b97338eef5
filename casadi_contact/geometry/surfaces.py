"""The signed distance of a `geometry.moving_surface`, of any family, as numba's kernels evaluate it."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.compilation import njit
from casadi_contact.geometry.distance_field import field_distance, field_value
from casadi_contact.geometry.moving_surface import CYLINDER, MESH_FIELD, NUMBERS_PER_ARC, SWEPT_ARCS


@njit(inline="always")
def signed_distance(family, parameters, x, y, z):
    """g(q) and its gradient (g, gx, gy, gz) at the point q = (x, y, z) of the moving frame."""
    if family == SWEPT_ARCS:
        last = int(parameters[0]) - 1
        radius = parameters[1]
        arc = 0
        base = 3
        dx = x - parameters[base]
        dy = y - parameters[base + 1]
        while arc < last and dx * parameters[base + 3] + dy * parameters[base + 4] > 0.0:
            arc += 1
            base += NUMBERS_PER_ARC
            dx = x - parameters[base]
            dy = y - parameters[base + 1]
        dz = z - parameters[2]
        rho = max(np.sqrt(dx * dx + dy * dy), 1e-12)
        out = rho - parameters[base + 2]
        distance = max(np.sqrt(out * out + dz * dz), 1e-12)
        scale = out / (distance * rho)
        return distance - radius, scale * dx, scale * dy, dz / distance
    if family == CYLINDER:
        rho = max(np.sqrt(x * x + y * y), 1e-12)
        return rho - parameters[0], x / rho, y / rho, 0.0
    if family == MESH_FIELD:
        return field_distance(parameters, x, y, z)
    return -y, 0.0, -1.0, 0.0


@njit(inline="always")
def signed_distance_value(family, parameters, x, y, z):
    """g(q) alone."""
    if family == MESH_FIELD:
        return field_value(parameters, x, y, z)
    return signed_distance(family, parameters, x, y, z)[0]
