"""The elastic layer of a scene's fixed body, and its pressure at a depth: the laws p(d)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from casadi_contact.scenes.shapes.checks import fail, number, table_of

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


@dataclass(frozen=True)
class Material:
    """Elastic layer of the fixed body: Young's modulus [MPa], Poisson's ratio, thickness [mm], pressure law."""

    youngs_modulus: float
    poissons_ratio: float
    thickness: float
    law: str = "linear"

    @classmethod
    def from_table(cls, table: object) -> Material:
        """From the scene's [material]; raises ValueError naming the key at fault."""
        values = table_of("material", table, ("youngs_modulus", "poissons_ratio", "thickness", "law"), complete=True)
        if values["law"] not in tuple(LAWS):  # a list or a table is not to be looked up
            raise fail("material.law", values["law"], " or ".join(LAWS))
        return cls(
            youngs_modulus=number("material.youngs_modulus", values["youngs_modulus"], low=0.0),
            poissons_ratio=number("material.poissons_ratio", values["poissons_ratio"], low=-1.0, high=0.5),
            thickness=number("material.thickness", values["thickness"], low=0.0),
            law=values["law"],
        )
