"""The elastic layer of a scene's fixed body, its pressure at a depth (the laws p(d)), and friction on its surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

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


@dataclass(frozen=True)
class Friction:
    """What the contact surface does where bodies move: coefficients by the names of OpenSim's ElasticFoundationForce.

    Static and dynamic friction are shares of the pressure, viscous friction [s/mm] is one for each mm/s of sliding, the
    transition velocity [mm/s] is that at which friction is largest, and dissipation [s/mm] the share by which each mm/s
    of approach raises the pressure (formulas: `contact.friction`). Without any, loads do not depend on velocities.
    """

    static_friction: float = 0.0
    dynamic_friction: float = 0.0
    viscous_friction: float = 0.0
    transition_velocity: float = 10.0
    dissipation: float = 0.0

    @classmethod
    def from_table(cls, table: object) -> Friction:
        """From the scene's [friction], where static friction left out is the dynamic one; raises ValueError naming the
        key at fault."""
        given = table_of("friction", table, FRICTION_NAMES, complete=False)
        values = {key: number(f"friction.{key}", value) for key, value in given.items()}
        for key, value in values.items():
            if value < 0.0 or (key == "transition_velocity" and value == 0.0):
                raise fail(f"friction.{key}", value, "0 or more" if value < 0.0 else "above 0 [mm/s]")
        values.setdefault("static_friction", values.get("dynamic_friction", 0.0))
        return cls(**values)


FRICTION_NAMES = tuple(field.name for field in fields(Friction))
