"""Pressure of an elastic layer bonded to a rigid backing: p(d) for depth d, layer thickness h.

    linear:       p = K d/h                    logarithmic:  p = -K ln(1 - d/h)
    K = (1 - ν)E / ((1 + ν)(1 - 2ν))

The logarithmic law is infinite at d = h; beyond d = 0.9 h it goes on along its tangent, so that a solver's deep
trial pose still gives a finite, growing pressure.
"""

from __future__ import annotations

import numba
import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.scenes import Material

LINEAR, LOGARITHMIC = 0, 1
LAW_CODES = {"linear": LINEAR, "log": LOGARITHMIC}
_TANGENT_STRAIN = 0.9


def layer_modulus(material: Material) -> float:
    """K = (1 - ν)E/((1 + ν)(1 - 2ν)) [MPa]: stiffness of a layer that cannot bulge sideways."""
    nu = material.poissons_ratio
    return (1.0 - nu) * material.youngs_modulus / ((1.0 + nu) * (1.0 - 2.0 * nu))


@numba.njit(cache=True, inline="always")
def pressure(law, modulus, thickness, depth):
    """p [MPa] and dp/dd [MPa/mm] for depth > 0 [mm]."""
    if law == LINEAR:
        slope = modulus / thickness
        return slope * depth, slope
    strain = depth / thickness
    if strain < _TANGENT_STRAIN:
        return -modulus * np.log1p(-strain), modulus / (thickness * (1.0 - strain))
    slope = modulus / (thickness * (1.0 - _TANGENT_STRAIN))
    return slope * (depth - _TANGENT_STRAIN * thickness) - modulus * np.log1p(-_TANGENT_STRAIN), slope


@numba.njit(cache=True)
def pressures(law, modulus, thickness, depths):
    """p [MPa] at each of the depths (n,) [mm]; zero where there is none (depth <= 0)."""
    values = np.zeros(len(depths))
    for n in range(len(depths)):
        if depths[n] > 0.0:
            values[n] = pressure(law, modulus, thickness, depths[n])[0]
    return values


def pressure_slopes(law: int, modulus: float, thickness: float, depths: Array) -> tuple[Array, Array]:
    """p [MPa] and dp/dd [MPa/mm] at depths (...) [mm]; zero where there is none."""
    loaded = depths > 0.0
    if law == LINEAR:
        stiffness = modulus / thickness
        return np.where(loaded, stiffness * depths, 0.0), np.where(loaded, stiffness, 0.0)
    strain = np.where(loaded, np.minimum(depths / thickness, _TANGENT_STRAIN), 0.0)
    slope = modulus / (thickness * (1.0 - strain))
    beyond = np.where(loaded, np.maximum(depths - _TANGENT_STRAIN * thickness, 0.0), 0.0)
    return slope * beyond - modulus * np.log1p(-strain), np.where(loaded, slope, 0.0)
