"""Pressure laws of an elastic layer bonded to a rigid backing: p(d) for depth d, modulus K and layer thickness h.

    linear:  p = K d/h                    log:  p = -K ln(1 - d/h)

The logarithmic law is infinite at d = h; beyond d = 0.9 h it goes on along its tangent, so that a solver's deep
trial pose still gives a finite, growing pressure. Each law is one function and one entry in ``LAWS``; numba compiles
it for the contact models (`contact.pressure_law`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

PressureLaw = Callable[[float, float, float], tuple[float, float, float]]
"""(K [MPa], h [mm], d > 0 [mm]) -> p [MPa], dp/dd [MPa/mm], d²p/dd² [MPa/mm²], in what numba can compile."""

TANGENT_STRAIN = 0.9


def _linear(modulus, thickness, depth):
    slope = modulus / thickness
    return slope * depth, slope, 0.0


def _logarithmic(modulus, thickness, depth):
    strain = depth / thickness
    if strain < TANGENT_STRAIN:
        slope = modulus / (thickness * (1.0 - strain))
        return -modulus * np.log1p(-strain), slope, slope / (thickness * (1.0 - strain))
    slope = modulus / (thickness * (1.0 - TANGENT_STRAIN))
    return slope * (depth - TANGENT_STRAIN * thickness) - modulus * np.log1p(-TANGENT_STRAIN), slope, 0.0


LAWS: dict[str, PressureLaw] = {"linear": _linear, "log": _logarithmic}
