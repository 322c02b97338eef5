"""Pressure moments of a ball in a cup (`contact.pressure.outputs`), in NumPy.

Besides the integrals of `cup.quadrature`: the area 2R²∫Φ dx, whose derivative comes from the edge of contact, where
x_edge moves by -d_b/d_x; and the largest depth, in the direction nearest to the ball.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cup.cup import Cup
from casadi_contact.contact.cup.quadrature import Cap, arcs_at, cap_of, first_moment, nearest_direction, rates
from casadi_contact.contact.pressure.law import pressure_slopes
from casadi_contact.contact.pressure.outputs import MOMENTS
from casadi_contact.core.conventions import Array


def cup_moments(cup: Cup, law: tuple[int, float, float], points: int, centres: Array) -> tuple[Array, Array]:
    """Moments (n, 6) of balls with their centres (n, 3), and their derivatives by the centre (n, 6, 3)."""
    cap, radius_2 = cap_of(cup, points, centres), cup.radius**2
    p, dp = pressure_slopes(*law, cap.s + cap.w - cup.radius)
    first, zero = cap.first(), np.zeros((len(centres), MOMENTS))
    value, slope = zero, np.zeros((len(centres), MOMENTS, 3))
    to_fixed = cap.frame
    force = np.einsum("nm,nmi,nij->nj", cap.weight * p, first, to_fixed)
    stiffness = np.einsum("nki,nm,nmkl,nlj->nij", to_fixed, cap.weight * dp, rates(cap, first), to_fixed)
    value[:, 0] = 2.0 * radius_2 * np.sum(cap.weight * cap.arc, axis=1)
    value[:, 1] = 2.0 * radius_2 * np.sum(cap.weight * p * cap.arc, axis=1)
    value[:, 2:5] = value[:, 1:2] * cup.centre + cup.radius**3 * force
    slope[:, 0] = _area_slope(cup, cap)
    rise = 1.0 + cap.s / cap.w
    along = rise[..., None] * first
    along[..., 0] -= 2.0 * cap.arc * cap.length[:, None] / cap.w
    slope[:, 1] = radius_2 * np.einsum("nm,nmi,nij->nj", cap.weight * dp, along, to_fixed)
    slope[:, 2:5] = cup.centre[:, None] * slope[:, 1:2] + cup.radius**3 * stiffness
    value[:, 5], slope[:, 5] = _largest_depth(cup, cap)
    loaded = value[:, 1] > 0.0
    return np.where(loaded[:, None], value, 0.0), np.where(loaded[:, None, None], slope, 0.0)


def _area_slope(cup: Cup, cap: Cap) -> Array:
    """R²/|d_x| ∫d_b dφ (n, 3) over the edge of contact."""
    w = np.maximum(cup.radius - cap.length * cap.edge, 1e-12)
    rise, lean = cup.radius / w, cap.length / w
    arc = arcs_at(cup, cap.cos_tilt, cap.sin_tilt, cap.edge)
    along = rise[:, None] * first_moment(cap.edge, arc)
    along[:, 0] -= 2.0 * lean * arc
    return np.einsum("ni,nij->nj", cup.radius**2 / (cap.length * rise)[:, None] * along, cap.frame)


def _largest_depth(cup: Cup, cap: Cap) -> tuple[Array, Array]:
    """s + w - R in the nearest direction (n,), and its derivatives by b (n, 3)."""
    e = nearest_direction(cup, cap)
    s = np.sum(e * cap.b, axis=1)
    w = np.sqrt(np.maximum(cup.ball_radius**2 - cap.length**2 + s * s, 1e-12))
    return s + w - cup.radius, (1.0 + s / w)[:, None] * e - cap.b / w[:, None]
