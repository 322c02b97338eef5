"""One cycle of inverse dynamics and muscle geometry: what it holds, and what no knee has.

Moment arms are arm = -∂length/∂coordinate: metres for rotations, direction cosines for translations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import COORDINATES, coordinate_unit, is_translation
from casadi_contact.optimisation.muscle import MuscleParameters
from casadi_contact.scenes.columns import check_rising
from casadi_contact.scenes.load_cycle import OverTime


@dataclass(frozen=True)
class MuscleWalk(OverTime):
    """One cycle of n frames and m muscles.

    time_s, rz, ry (n,); loads (n,) [N, N·m] and arms (n, m) by coordinate of `COORDINATES`; lengths_m and
    velocities_m_per_s (n, m) of the musculotendons, lengthening positive; parameters of the muscles.
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
            raise ValueError(
                f"walk {self.name}: got loads of {', '.join(self.loads)} and arms about {', '.join(self.arms)}, "
                f"expected the same coordinates in both, of {', '.join(COORDINATES)}"
            )
        _check_units_and_signs(self)

    def check_has(self, coordinates: Iterable[str]) -> None:
        """ValueError for coordinates of which the walk has no loads and arms."""
        if missing := [name for name in coordinates if name not in self.loads]:
            raise ValueError(
                f"walk {self.name} has loads and arms of {', '.join(self.loads)}, expected {', '.join(missing)} too: "
                "add their columns to inverse dynamics (knee_ty_N) and muscles (arm_knee_ty)"
            )


def _check_units_and_signs(walk: MuscleWalk) -> None:
    """ValueError for lengths and arms in mm, loads over body weight, and reversed signs of arms or velocities."""

    def fail(got: str, expected: str, cure: str) -> ValueError:
        return ValueError(f"walk {walk.name}: {got}, expected {expected}: {cure}")

    if walk.lengths_m.min() <= 0.0 or walk.lengths_m.max() > 2.0:
        raise fail(f"lengths reach {walk.lengths_m.max():g} m", "above 0, at most 2 m", "is their unit mm?")
    for name, table in walk.arms.items():
        limit, unit = (1.5, "direction cosines") if is_translation(name) else (0.3, "m")
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
