"""Pressure moments of cubic cells (`contact.pressure_outputs`), in NumPy, over the sub-points of depth d and area A.

The area is Σ A·φ'(d) with φ the ramp that does not dip (`basis.positive_ramp`). The largest depth, of any number of
spots, is a smooth maximum: with s = φ(d) and p = `POWER`, (p + 2)/(p + 1)·Σ A·s^(p+1)/Σ A·s^p, which is exact for spots
whose depth falls off as a paraboloid; a ridge's is 1.5 %, a flat punch's 3 % too large. All fade out with the loads at
the brink of contact. The kernel in C (``c/cells_pressures.h``) follows the same formulas.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.cells.basis import corner_shares, positive_ramp, smooth_step
from casadi_contact.contact.cells.quadrature import WIDTH_MM, Quadrature
from casadi_contact.contact.pressure_outputs import MOMENTS
from casadi_contact.conventions import Array

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
    s, s_slope = positive_ramp(touch.depth, WIDTH_MM)
    s_bend = np.maximum(1.0 - (touch.depth / WIDTH_MM) ** 2, 0.0) * 0.75 / WIDTH_MM
    area = p.present[touch.cells] * (areas[touch.corners] @ corner_shares(quad.cells))
    share = s / quad.law[2]
    weight = area * share**POWER
    total, mean = weight.sum(), (weight * share).sum() / weight.sum()
    by_s = _FULL / total * s_slope * ((POWER + 1.0) * weight - POWER * area * share ** (POWER - 1) * mean)
    value = np.concatenate([[(area * s_slope).sum()], touch.weights @ pressed, [_FULL * quad.law[2] * mean]])
    slope = np.vstack([_sum(area * s_bend, by_depth), pressed.T @ by_node, _sum(by_s, by_depth)])
    fade, fade_slope = smooth_step(value[1] / quad.fade_n)
    return fade * value, fade * slope + np.outer(value, slope[1]) * fade_slope / quad.fade_n


def _sum(weight: Array, by_depth: Array) -> Array:
    return np.einsum("kr,kra->a", weight, by_depth)
