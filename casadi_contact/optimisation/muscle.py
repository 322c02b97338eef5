"""Muscles with a rigid tendon: how much force an activation gives at a musculotendon's length and velocity.

    F = F0·(a·f_l(l)·f_v(v) + f_p(l))·cos α        [N]

    L = (length - slack)/cos α, the fibre, of constant thickness L·sin α = L0·sin α0; l = L/L0
    v = velocity·cos α/(v_max·L0), negative while the fibre shortens

The normalised curves are those of De Groote, Kinney, Rao, Fregly, Ann Biomed Eng 44 (2016) 2922-2936, with the digits
and the passive curve's offset (no force below l = 0.2) of OpenSim's DeGrooteFregly2016Muscle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import COORDINATES, coordinate_unit
from casadi_contact.scenes.columns import check_rising
from casadi_contact.scenes.cycle import OverTime

MAX_FIBRE_SPEED_PER_S = 10.0  # optimal lengths per second
LONGEST_FIBRE = 1.2  # of optimal length, in level walking: beyond it passive force sets in, here 7 % of the greatest


def active_force_length(length: Any, xp: Any = np) -> Any:
    """f_l(l) of the fibre's length over its optimal length: three bells, 1 near l = 1. xp: numpy or casadi, whose
    numbers are given."""
    gaussians = (  # height, place, width, growth of the width
        (0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465),
        (0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188),
        (0.1, 1.0, 0.353553390593274, 0.0),
    )
    bells = (
        height * xp.exp(-0.5 * ((length - place) / (width + growth * length)) ** 2)
        for height, place, width, growth in gaussians
    )
    return sum(bells)


def force_velocity(velocity: Any, xp: Any = np) -> Any:
    """f_v(v) of the fibre's velocity over its greatest speed: 0 at v = -1, 1 at 0, 1.8 at 1."""
    d1, d2, d3, d4 = -0.3211346127989808, -8.149, -0.374, 0.8825327733249912
    return d1 * xp.arcsinh(d2 * velocity + d3) + d4


def passive_force_length(length: Any, xp: Any = np) -> Any:
    """f_p(l): 0 at l = 0.2, about 0.02 at l = 1, 1 at l = 1.6."""
    shape, strain, shortest = 4.0, 0.6, 0.2
    offset = np.exp(shape * (shortest - 1.0) / strain)
    return (xp.exp(shape * (length - 1.0) / strain) - offset) / (np.exp(shape) - offset)


@dataclass(frozen=True)
class MuscleParameters:
    """One value (m,) for each muscle: greatest isometric force [N], optimal fibre and tendon slack length [m], and
    pennation [rad] of the fibre at optimal length. Raises ValueError for values that no muscle has."""

    names: tuple[str, ...]
    max_isometric_force_n: Array
    optimal_fibre_length_m: Array
    tendon_slack_length_m: Array
    pennation_rad: Array

    def __post_init__(self) -> None:
        if len(set(self.names)) != len(self.names) or not self.names:
            raise ValueError(f"muscles are {', '.join(self.names) or '(none)'}, expected each named once")
        limits = {
            "max_isometric_force_n": (np.inf, "a positive force in N"),
            "optimal_fibre_length_m": (1.0, "between 0 and 1 m: is its unit mm?"),
            "tendon_slack_length_m": (1.0, "between 0 and 1 m: is its unit mm?"),
            "pennation_rad": (np.pi / 2.0, "0 to 1.57 rad: is its unit degrees?"),
        }
        for key, (limit, expected) in limits.items():
            values = np.asarray(getattr(self, key), dtype=float)
            if values.shape != (len(self.names),):
                raise ValueError(f"{key} has shape {values.shape}, expected a value for each of {len(self.names)}")
            least = 0.0 if key == "pennation_rad" else np.finfo(float).tiny
            good = np.isfinite(values) & (values >= least) & (values < limit)
            if not good.all():
                worst = int(good.argmin())
                raise ValueError(f"{key} of {self.names[worst]} is {values[worst]:g}, expected {expected}")
            object.__setattr__(self, key, values)

    def fitted_to(self, lengths_m: Array) -> MuscleParameters:
        """Fibres and tendons of an average person scaled to another's musculotendon lengths (n, m): by one factor for
        each muscle, so that its longest length stretches the fibre to `LONGEST_FIBRE` of its optimum; where that leaves
        the tendon slack at its shortest length, by a factor each, so that the shortest just straightens the tendon."""
        shortest, longest = lengths_m.min(axis=0), lengths_m.max(axis=0)
        stretched = np.sqrt(LONGEST_FIBRE**2 - np.sin(self.pennation_rad) ** 2)  # along the tendon, of optimal length
        factor = longest / (self.tendon_slack_length_m + self.optimal_fibre_length_m * stretched)
        fibre, tendon = factor * self.optimal_fibre_length_m, factor * self.tendon_slack_length_m
        slack = tendon > shortest
        fibre = np.where(slack, (longest - shortest) / stretched, fibre)
        return replace(self, optimal_fibre_length_m=fibre, tendon_slack_length_m=np.where(slack, shortest, tendon))


def rigid_tendon_forces(muscles: MuscleParameters, length_m: Any, velocity_m_per_s: Any, xp: Any = np) -> Any:
    """Active force at full activation and passive force along the tendon [N], and l, of musculotendon lengths and
    velocities (n, m), or (m) as CasADi expressions; xp: numpy or casadi. No force where the tendon is slack."""
    force, optimum = muscles.max_isometric_force_n, muscles.optimal_fibre_length_m
    along = xp.fmax(length_m - muscles.tendon_slack_length_m, 0.0)
    fibre_m = xp.sqrt(along**2 + (optimum * np.sin(muscles.pennation_rad)) ** 2 + 1e-30)  # 0 of a slack parallel fibre
    cosine, fibre = along / fibre_m, fibre_m / optimum
    velocity = velocity_m_per_s * cosine / (MAX_FIBRE_SPEED_PER_S * optimum)
    active = cosine * force * active_force_length(fibre, xp) * xp.fmax(force_velocity(velocity, xp), 0.0)
    return active, cosine * force * xp.fmax(passive_force_length(fibre, xp), 0.0), fibre


@dataclass(frozen=True)
class MuscleWalk(OverTime):
    """One cycle of inverse dynamics and muscle geometry, of n frames and m muscles.

    time_s, rz, ry (n,); loads (n,) [N, N·m] and arms -∂length/∂coordinate (n, m) [direction cosines, m] by coordinate
    of `COORDINATES`; lengths_m and velocities_m_per_s (n, m) of the musculotendons, lengthening positive; parameters of
    the muscles.
    Raises ValueError for wrong shapes, numbers that are not finite, unsorted time, and units or signs that no knee has.
    """

    name: str
    time_s: Array
    rz: Array
    ry: Array
    loads: Mapping[str, Array]
    arms: Mapping[str, Array]
    lengths_m: Array
    velocities_m_per_s: Array
    muscles: MuscleParameters

    def __post_init__(self) -> None:
        frames, count = len(self.time_s), len(self.muscles.names)
        curves = {"rz": self.rz, "ry": self.ry, **{f"load {name}": curve for name, curve in self.loads.items()}}
        tables = {"lengths": self.lengths_m, "velocities": self.velocities_m_per_s}
        tables |= {f"arms about {name}": table for name, table in self.arms.items()}
        for shape, named in (((frames,), curves), ((frames, count), tables)):
            for what, values in named.items():
                if values.shape != shape or not np.isfinite(values).all():
                    raise ValueError(f"walk {self.name}: {what} has shape {values.shape}, expected finite {shape}")
        check_rising(f"walk {self.name}", self.time_s)
        if set(self.loads) != set(self.arms) or not set(self.loads) <= set(COORDINATES):
            got = f"got loads of {', '.join(self.loads)} and arms about {', '.join(self.arms)}"
            raise ValueError(f"walk {self.name}: {got}, expected the same ones of {', '.join(COORDINATES)}")
        _check_units_and_signs(self)

    def check_has(self, coordinates: Iterable[str]) -> None:
        """ValueError for coordinates of which the walk has no loads and arms."""
        if missing := [name for name in coordinates if name not in self.loads]:
            has = ", ".join(self.loads)
            raise ValueError(f"walk {self.name} has loads and arms of {has}, expected {', '.join(missing)} too")


def _check_units_and_signs(walk: MuscleWalk) -> None:
    """ValueError for lengths and arms in mm, loads over body weight, and reversed signs of arms or velocities."""

    def fail(got: str, expected: str, cure: str) -> ValueError:
        return ValueError(f"walk {walk.name}: {got}, expected {expected}: {cure}")

    if walk.lengths_m.min() <= 0.0 or walk.lengths_m.max() > 2.0:
        raise fail(f"lengths reach {walk.lengths_m.max():g} m", "above 0, at most 2 m", "is their unit mm?")
    for name, table in walk.arms.items():
        limit, unit = (1.5, "direction cosines") if coordinate_unit(name) == "N" else (0.3, "m")
        if np.abs(table).max() > limit:
            raise fail(f"arms about {name} reach {np.abs(table).max():g}", f"{unit} up to {limit:g}", "check the unit")
    for unit, least, most in (("N", 10.0, np.inf), ("Nm", 1.5, 1e3)):
        curves = [np.abs(curve).max() for name, curve in walk.loads.items() if coordinate_unit(name) == unit]
        if curves and not (max(curves) == 0.0 or least <= max(curves) <= most):
            raise fail(f"loads reach {max(curves):g} {unit}", "those of a body", "check the unit (body weight? N·mm?)")
    if "knee_ty" in walk.arms and walk.arms["knee_ty"].mean() > 0.0:
        raise fail("the mean arm about knee_ty is above 0", "arm = -dlength/dcoordinate", "turn the sign of arms")
    rates = np.gradient(walk.lengths_m, walk.time_s, axis=0)
    if len(walk.time_s) >= 10 and (rates * walk.velocities_m_per_s).sum() < 0.0:  # fewer do not tell rates
        raise fail("muscles lengthen at negative velocity", "v = dlength/dt", "turn the sign of velocities")
