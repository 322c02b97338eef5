"""Pressure moments by polar quadrature (`contact.pressure.outputs`), in NumPy.

The area's derivative comes from the edge r_j of each line: Σ width·|N|·∂r_j, with ∂r_j = -∂d/d_r, none where the rim
ends it. The kernel in C (``c/polar_pressures.h``) follows the same formulas.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.polar.ends import LEAST_RISE, Ends, ray_ends, rise
from casadi_contact.contact.polar.middle import middle
from casadi_contact.contact.polar.nearest import deepest_within
from casadi_contact.contact.polar.patches import SmoothPatch
from casadi_contact.contact.polar.quadrature import Integration, integration
from casadi_contact.contact.polar.rays import Rays
from casadi_contact.contact.pressure.law import pressure_slopes
from casadi_contact.contact.pressure.outputs import MOMENTS
from casadi_contact.contact.twist import twist
from casadi_contact.core.conventions import Array


def patch_moments(
    patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, R: Array, t: Array
) -> tuple[Array, Array]:
    """Moments (n, 6) of one patch and their derivatives by the twist of the moving body about t (n, 6, 6)."""
    R, t = patch.turn @ R, t @ patch.turn.T
    m = middle(patch, R, t)
    loaded = m.spot.depth > 0.0
    found = integration(patch, R, t, m, rays)
    ends = found.ends
    p, dp = pressure_slopes(*law, ends.depth)
    area = found.weight * ends.length
    by_twist = _depth_slope(ends, t)
    value, slope = np.zeros((len(t), MOMENTS)), np.zeros((len(t), MOMENTS, 6))
    value[:, 0], value[:, 1] = np.sum(area, (1, 2)), np.sum(area * p, (1, 2))
    value[:, 2:5] = np.einsum("nmg,nmgi->ni", area * p, ends.c) @ patch.turn
    slope[:, 0] = _area_slope(patch, R, t, found)
    slope[:, 1] = np.einsum("nmg,nmga->na", area * dp, by_twist)
    slope[:, 2:5] = patch.turn.T @ np.einsum("nmg,nmgi,nmga->nia", area * dp, ends.c, by_twist)
    there = deepest_within(patch, R, t, m.spot.u, m.spot.v)
    value[:, 5], slope[:, 5] = there.depth, _depth_slope(there.ends, t)
    slope = slope @ np.kron(np.eye(2), patch.turn)
    return np.where(loaded[:, None], value, 0.0), np.where(loaded[:, None, None], slope, 0.0)


def _depth_slope(ends: Ends, t: Array) -> Array:
    """dd/dtwist (n, ..., 6) = -(G, arm × G)/σ."""
    arm = ends.x - t.reshape(len(t), *([1] * (ends.x.ndim - 2)), 3)
    return -twist(ends.G, arm) / ends.slope[..., None]


def _area_slope(patch: SmoothPatch, R: Array, t: Array, found: Integration) -> Array:
    """Derivative (n, 6) of the area by the twist, in chart axes."""
    lines = found.lines
    ends = ray_ends(patch, R, t, *lines.at(lines.edge), arc=lines.arc)
    steepness = np.minimum(rise(ends, *np.moveaxis(lines.directions, -1, 0)) / ends.slope, -LEAST_RISE)
    width = (lines.width + lines.spread * lines.edge) * ends.length * ~found.cut
    return -np.einsum("nm,nma->na", width / steepness, _depth_slope(ends, t))
