"""Cubic cells: the Hermite functions of a cell at its sub-points, and the smooth forms of max(x, 0)."""

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Cells:
    """Size of a patch's cells [mm] along u and v, where the surface is flat, and sub-points of each along both."""

    u_mm: float
    v_mm: float
    along_u: int = 4
    along_v: int = 3

    @property
    def sub_points(self) -> int:
        """Of each cell."""
        return self.along_u * self.along_v

    def __str__(self) -> str:
        return f"cells of {self.u_mm:.3g}×{self.v_mm:.3g} mm with {self.along_u}×{self.along_v} sub-points"


def hermite_functions(cells: Cells) -> Array:
    """B (12, sub-points): d, ∂d/∂ξ, ∂d/∂η at the corners 00, 01, 10, 11 -> d at the sub-points.

    Products of the cubic Hermite functions of ξ and η, from 0 to 1 along u and v: ∂²d/∂ξ∂η is zero at the corners.
    """
    return hermite_products(middles(cells.along_u), middles(cells.along_v))


def hermite_products(xi: Array, eta: Array) -> Array:
    """The functions of `hermite_functions` at the points of a grid ξ (n,), η (m,): (12, n·m)."""
    (u, u_slope), (v, v_slope) = _hermite(xi), _hermite(eta)
    corners = ((u[a], u_slope[a], v[b], v_slope[b]) for a in (0, 1) for b in (0, 1))
    rows = [np.outer(*pair) for x, dx, y, dy in corners for pair in ((x, y), (dx, y), (x, dy))]
    return np.stack(rows).reshape(12, -1)


def corner_shares(cells: Cells) -> Array:
    """(4, sub-points): bilinear share of each corner in a sub-point, over the number of sub-points."""
    return np.einsum("ia,jb->abij", linear_shares(cells.along_u), linear_shares(cells.along_v)).reshape(4, -1)


def hermite_of(count: int) -> Array:
    """(count, 4): Hermite functions at sub-points along one side: value and slope at the first end, then the other."""
    return np.stack(_hermite(middles(count))).transpose(2, 1, 0).reshape(count, 4)


def linear_shares(count: int) -> Array:
    """(count, 2): linear share of each end in a sub-point along one side, over their number."""
    t = middles(count)
    return np.stack([1.0 - t, t], 1) / count


def share_products(count: int) -> Array:
    """(count, 8): each end's share times each function of `hermite_of`."""
    return (linear_shares(count)[:, :, None] * hermite_of(count)[:, None]).reshape(count, 8)


def middles(count: int) -> Array:
    """Middles (count,) of equal parts of [0, 1]."""
    return (np.arange(count) + 0.5) / count


def _hermite(t: Array) -> tuple[Array, Array]:
    """Cubics with the value, and the slope, 1 at 0 or at 1: (2, n) each."""
    rise = t * t * (3.0 - 2.0 * t)
    return np.stack([1.0 - rise, rise]), np.stack([t * (1.0 - t) ** 2, t * t * (t - 1.0)])


def ramp(x: Array, width: float) -> tuple[Array, Array]:
    """max(x, 0) smoothed to fourth order over ±width, and its slope: twice continuously differentiable.

    u = x/width: width·[u/2 + 15/32·(3u²/2 - 5u⁴/6 + 7u⁶/30) + 5/64] within, 0 below and x above. It is the convolution
    of max(x, 0) with 15/32·(1 - u²)(3 - 7u²), which has no second moment: an integral over a straight edge is right to
    the fourth order of the width. It dips to -0.015·width below zero.
    """
    u = np.clip(x / width, -1.0, 1.0)
    u2 = u * u
    within = width * (0.5 * u + 15.0 / 32.0 * u2 * (1.5 - 5.0 / 6.0 * u2 + 7.0 / 30.0 * u2 * u2) + 5.0 / 64.0)
    slope = 0.5 + 15.0 / 32.0 * u * (3.0 - 10.0 / 3.0 * u2 + 1.4 * u2 * u2)
    return np.where(x > width, x, np.where(x < -width, 0.0, within)), slope


def positive_ramp(x: Array, width: float) -> tuple[Array, Array, Array]:
    """max(x, 0) smoothed over ±width without a dip: width·(u + 1)³(3 - u)/16, u = x/width, and two derivatives (C²)."""
    u = np.clip(x / width, -1.0, 1.0)
    within = width * (u + 1.0) ** 3 * (3.0 - u) / 16.0
    return np.where(x > width, x, within), 0.25 * (u + 1.0) ** 2 * (2.0 - u), 0.75 / width * (1.0 - u * u)


def smooth_step(x: Array) -> tuple[Array, Array]:
    """x³(10 - 15x + 6x²) from 0 at x <= 0 to 1 at x >= 1, and its slope (C²)."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) ** 2
