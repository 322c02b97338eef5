"""Signed distance g of a `geometry.moving_surface` of any family, with first and second derivatives."""

import numpy as np

from casadi_contact.core.compilation import njit
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import field_distance, field_distances, field_hessian
from casadi_contact.geometry.moving_surface import (
    CYLINDER,
    HALF_SPACE,
    MESH_FIELD,
    NUMBERS_PER_ARC,
    SWEPT_ARCS,
    MovingSurface,
)


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
    return -parameters[0] * y, 0.0, -parameters[0], 0.0


def distance_derivatives(surface: MovingSurface, points: Array) -> tuple[Array, Array, Array]:
    """g (n,), ∇g (n, 3) and ∇²g (n, 3, 3) at points (n, 3) of the moving frame.

    Outside its grid a field is what it is at the nearest point of the grid, plus the distance to that, taken as flat.
    Swept arcs must be a ball: one arc whose tube's centre lies on its axis.
    """
    if surface.family == MESH_FIELD:
        return field_derivatives(surface.parameters, points)
    gradients, hessians = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
    if surface.family == HALF_SPACE:
        gradients[:, 1] = -surface.parameters[0]
        return gradients[:, 1] * points[:, 1], gradients, hessians
    across, centre, radius = round_body(surface)
    offset = (points - centre) * across
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    gradients = offset / distance[:, None]
    hessians = (np.diag(across) - gradients[:, :, None] * gradients[:, None, :]) / distance[:, None, None]
    return distance - radius, gradients, hessians


def distance_gradients(surface: MovingSurface, points: Array) -> tuple[Array, Array]:
    """g (n,) and ∇g (n, 3), as of `distance_derivatives`, in a fraction of its time."""
    if surface.family != MESH_FIELD:
        return distance_derivatives(surface, points)[:2]
    values = field_distances(surface.parameters, np.ascontiguousarray(points))
    return values[:, 0], values[:, 1:]


def round_body(surface: MovingSurface) -> tuple[Array, Array, float]:
    """Axes (3,) that a ball's or a cylinder's distance depends on (1 or 0), centre (3,), radius [mm], or ValueError."""
    if surface.family == CYLINDER:
        return np.array([1.0, 1.0, 0.0]), np.zeros(3), float(surface.parameters[0])
    count, radius, centre_z, x, y, offset = surface.parameters[:6]
    if count != 1.0 or offset != 0.0:
        raise ValueError(f"the moving body is swept along {count:g} arcs with an offset, expected a ball or a cylinder")
    return np.ones(3), np.array([x, y, centre_z]), float(radius)


def field_derivatives(parameters: Array, points: Array) -> tuple[Array, Array, Array]:
    """g (n,), ∇g (n, 3) and ∇²g (n, 3, 3) of a field's parameters at points (n, 3)."""
    values = _field_derivatives(parameters, np.ascontiguousarray(points, dtype=float))
    return values[:, 0], values[:, 1:4], values[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)


@njit()
def _field_derivatives(parameters, points):
    values = np.empty((len(points), 10))
    for n in range(len(points)):
        values[n] = field_hessian(parameters, points[n, 0], points[n, 1], points[n, 2])
    return values
