"""The elastic layers of a scene's bodies, their pressure at a depth (the laws p(d)), and friction on their surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.shapes.checks import fail, number, numbers, table_of

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
class Layer:
    """An elastic layer on a rigid back: Young's modulus [MPa], Poisson's ratio, thickness [mm]."""

    youngs_modulus: float
    poissons_ratio: float
    thickness: float

    @property
    def modulus(self) -> float:
        """K = (1 - ν)E/((1 + ν)(1 - 2ν)) [MPa]: stiffness of a layer that cannot bulge sideways."""
        nu = self.poissons_ratio
        return (1.0 - nu) * self.youngs_modulus / ((1.0 + nu) * (1.0 - 2.0 * nu))

    @classmethod
    def checked(cls, key: str, values: Mapping[str, Any]) -> Layer:
        """Of a scene's table by this key; raises ValueError naming the value at fault."""
        above = {"low": 0.0}
        bounds = {"youngs_modulus": above, "poissons_ratio": {"low": -1.0, "high": 0.5}, "thickness": above}
        return cls(**{name: number(f"{key}.{name}", values[name], **limits) for name, limits in bounds.items()})


@dataclass(frozen=True)
class Material(Layer):
    """The elastic layer of the fixed body and its pressure law; `moving`: a second one, on the moving body.

    Two layers are springs in series, whose pressures are equal: h/K = h1/K1 + h2/K2, so that the pair is a single layer
    of the modulus K1 and the thickness h1 + h2·K1/K2. This is exact for the linear law, and for the logarithmic one
    where both have the same K; else that is right to the first order in the strains.

    thickness_map: x (m,), z (n,) [mm] in the fixed body's frame and thicknesses (m, n) [mm] of its layer there, natural
    cubic splines between and constant beyond; `thickness` is then the scale that parameters and pictures refer to.
    """

    law: str = "linear"
    moving: Layer | None = field(default=None, repr=False)
    thickness_map: tuple[tuple[float, ...], ...] | None = field(default=None, repr=False)

    @classmethod
    def from_table(cls, table: object) -> Material:
        """From the scene's [material]; raises ValueError naming the key at fault."""
        names, more = ("youngs_modulus", "poissons_ratio", "thickness"), ("moving", "thickness_map")
        values = table_of("material", table, (*names, "law"), complete=True, optional=more)
        if values["law"] not in tuple(LAWS):  # a list or a table is not to be looked up
            raise fail("material.law", values["law"], " or ".join(LAWS))
        own, moving, mapped = Layer.checked("material", values), None, None
        if "moving" in values:
            key = "material.moving"
            moving = Layer.checked(key, table_of(key, values["moving"], names, complete=True))
        if "thickness_map" in values:
            mapped = _checked_map(values["thickness_map"])
        return cls(**vars(own), law=values["law"], moving=moving, thickness_map=mapped)

    @property
    def in_series(self) -> float:
        """Thickness [mm] of the moving body's layer, as one of the fixed body's modulus."""
        return 0.0 if self.moving is None else self.moving.thickness * self.modulus / self.moving.modulus

    def thickness_at(self, points_mm: Array) -> Array:
        """Thickness (n,) [mm] of the fixed body's layer under points (n, 3) of its surface."""
        if self.thickness_map is None:
            return np.full(len(points_mm), self.thickness)
        x, z, *rows = map(np.array, self.thickness_map)
        return np.einsum("ni,ij,nj->n", _cardinals(x, points_mm[:, 0]), np.array(rows), _cardinals(z, points_mm[:, 2]))


def _cardinals(places: Array, at: Array) -> Array:
    """Natural cubic splines (n, m) that are 1 at one of the places (m,) and 0 at the others."""
    if len(places) == 1:
        return np.ones((len(at), 1))
    from scipy.interpolate import CubicSpline  # most scenes have no map, and load without it

    return np.asarray(CubicSpline(places, np.eye(len(places)), bc_type="natural")(np.clip(at, places[0], places[-1])))


def _checked_map(table: object) -> tuple[tuple[float, ...], ...]:
    """x, z and the rows along z of a [material.thickness_map]."""
    key = "material.thickness_map"
    values = table_of(key, table, ("x", "z", "mm"), complete=True)
    x, z = (numbers(f"{key}.{axis}", values[axis], None, "mm") for axis in "xz")
    for axis, places in (("x", x), ("z", z)):
        if not places or any(b <= a for a, b in pairwise(places)):
            raise fail(f"{key}.{axis}", places, "rising numbers [mm]")
    if not isinstance(values["mm"], list | tuple) or len(values["mm"]) != len(x):
        raise fail(f"{key}.mm", values["mm"], f"a row for each of the {len(x)} places along x")
    rows = [numbers(f"{key}.mm", row, len(z), "mm", low=0.0) for row in values["mm"]]
    between = (_cardinals(np.array(at), np.linspace(at[0], at[-1], 101)) for at in (x, z))
    if not (least := np.min(next(between) @ np.array(rows) @ next(between).T)) > 0.0:
        raise fail(f"{key}.mm", rows, f"thicknesses whose splines stay above 0 mm, not {least:.2g}")
    return tuple(x), tuple(z), *map(tuple, rows)


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
        """From the scene's [friction]; static friction left out is the dynamic one. ValueError names the key."""
        given = table_of("friction", table, FRICTION_NAMES, complete=False)
        values = {key: number(f"friction.{key}", value) for key, value in given.items()}
        for key, value in values.items():
            if value < 0.0 or (key == "transition_velocity" and value == 0.0):
                raise fail(f"friction.{key}", value, "0 or more" if value < 0.0 else "above 0 [mm/s]")
        values.setdefault("static_friction", values.get("dynamic_friction", 0.0))
        return cls(**values)


FRICTION_NAMES = tuple(each.name for each in fields(Friction))
