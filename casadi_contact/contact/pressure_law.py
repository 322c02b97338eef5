"""The pressure laws compiled for elements' loops: p(d), zero for d <= 0, with K = (1 - ν)E / ((1 + ν)(1 - 2ν)).

Laws go by number into compiled code, their place in `scenes.material.LAWS`.
"""

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.compilation import njit
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.material import LAWS, Material, PressureLaw


def law_number(name: str) -> int:
    """Number of a law in compiled code; raises ValueError for an unknown law."""
    if name not in LAWS:
        raise ValueError(f"unknown pressure law {name!r}, expected one of {', '.join(LAWS)}")
    return list(LAWS).index(name)


def law_of(material: Material) -> tuple[int, float, float]:
    """What compiled laws are called with: number, modulus K [MPa], thickness h [mm] of both layers in series."""
    return law_number(material.law), material.modulus, material.thickness + material.in_series


def compile_laws(laws: Sequence[PressureLaw], first: int = 0) -> Any:
    """(number, K, h, d > 0) -> p, dp/dd, d²p/dd² of the law with that number; NaN for a number that is no law's."""
    if not laws:
        return numba.njit(inline="always")(lambda number, modulus, thickness, depth: (np.nan, np.nan, np.nan))
    law, others = numba.njit(inline="always")(laws[0]), compile_laws(laws[1:], first + 1)

    @numba.njit(inline="always")
    def pressure(number, modulus, thickness, depth):
        if number == first:
            return law(modulus, thickness, depth)
        return others(number, modulus, thickness, depth)

    return pressure


pressure = compile_laws(list(LAWS.values()))


def pressures(number: int, modulus: float, thickness: ArrayLike, depths: Array) -> Array:
    """p [MPa] at depths (...) [mm]; zero where there is none (depth <= 0). thickness: one, or as many."""
    return pressure_derivatives(number, modulus, thickness, depths)[0]


def pressure_derivatives(number: int, modulus: float, thickness: ArrayLike, depths: Array) -> tuple[Array, Array]:
    """p [MPa] and dp/dd [MPa/mm] at depths (...) [mm]; zero where there is none."""
    of_each = np.broadcast_to(np.asarray(thickness, dtype=float), depths.shape)
    values, derivatives = _derivatives(number, modulus, of_each.ravel(), np.ascontiguousarray(depths).ravel())
    return values.reshape(depths.shape), derivatives.reshape(depths.shape)


@njit()
def _derivatives(number, modulus, thickness, depths):
    values, derivatives = np.zeros(len(depths)), np.zeros(len(depths))
    for n in range(len(depths)):
        if depths[n] > 0.0:
            values[n], derivatives[n], _ = pressure(number, modulus, thickness[n], depths[n])
    return values, derivatives
