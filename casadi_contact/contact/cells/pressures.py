"""Pressure moments of cubic cells (`contact.pressure.outputs`), in NumPy, over the sub-points of depth d and area A.

The area is Σ A·φ'(d) with φ the ramp that does not dip (`basis.positive_ramp`). The largest depth, of any number of
spots, is a smooth maximum: with s = φ(d) and p = `POWER`, (p + 2)/(p + 1)·Σ A·s^(p+1)/Σ A·s^p, which is exact for spots
whose depth falls off as a paraboloid; a ridge's is 1.5 %, a flat punch's 3 % too large. Its depths are those of
`Quadrature.facing`: beside an edge of the body interpolated ones overshoot. All fade out with the loads at the brink of
contact. The kernel in C (``c/cells_pressures.h``) follows the same formulas.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cells.basis import corner_shares, positive_ramp, smooth_step
from casadi_contact.contact.cells.quadrature import WIDTH_MM, Quadrature, Touch
from casadi_contact.contact.pressure.outputs import MOMENTS
from casadi_contact.core.conventions import Array

POWER = 32
_FULL = (POWER + 2.0) / (POWER + 1.0)


def cell_moments(quad: Quadrature, R: Array, t: Array) -> tuple[Array, Array]:
    """Moments (6,) of one patch and their derivatives by the twist of the moving body about t (6, 6)."""
    touch = quad.touch(R, t)
    if not touch.total[6] < 0.0:
        return np.zeros(MOMENTS), np.zeros((MOMENTS, 6))
    p, used = quad.patch, touch.nodes.used
    areas = p.loads[used, 6]
    pressed = np.column_stack([areas, areas[:, None] * p.c[used]])
    by_node, by_depth = quad.slopes(touch)
    in_contact = positive_ramp(touch.depth, WIDTH_MM)[1]
    in_contact_slope = np.maximum(1.0 - (touch.depth / WIDTH_MM) ** 2, 0.0) * 0.75 / WIDTH_MM
    area = p.present[touch.cells] * (areas[touch.corners] @ corner_shares(quad.cells))
    largest, by_largest = _largest(quad, touch, area)
    value = np.concatenate([[(area * in_contact).sum()], touch.weights @ pressed, [largest]])
    slope = np.vstack([_sum(area * in_contact_slope, by_depth), pressed.T @ by_node, by_largest])
    fade, fade_slope = smooth_step(value[1] / quad.fade_n)
    return fade * value, fade * slope + np.outer(value, slope[1]) * fade_slope / quad.fade_n


def _largest(quad: Quadrature, touch: Touch, area: Array) -> tuple[float, Array]:
    """The largest depth [mm] and its derivatives by twist (6,); 0 where none faces the fixed surface."""
    depth, by_depth = quad.facing(touch)
    s, slope = positive_ramp(depth, WIDTH_MM)
    share = s / quad.law[2]
    weight = area * share**POWER
    total = weight.sum()
    if not total > 0.0:
        return 0.0, np.zeros(6)
    mean = (weight * share).sum() / total
    by_s = _FULL / total * slope * ((POWER + 1.0) * weight - POWER * area * share ** (POWER - 1) * mean)
    return _FULL * quad.law[2] * mean, _sum(by_s, by_depth)


def _sum(weight: Array, by_depth: Array) -> Array:
    return np.einsum("kr,kra->a", weight, by_depth)
