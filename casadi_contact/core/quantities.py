"""Quantities: what a named number measures, and its unit.

Poses, loads and whatever else a model gives go by name ("rz", "Fy_med", "peak_pressure_lat"); the part of the name
before the patch says what is measured. Units, labels, columns of files, error tables and conversions are looked up
here: a new output of contact models is a line in `KINDS`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Kind:
    """A kind of quantity and its unit inside the library."""

    name: str
    unit: str

    @property
    def plain_unit(self) -> str:
        """The unit in ASCII, for columns of files: Nmm, mm2."""
        return self.unit.replace("·", "").replace("²", "2")


FORCE = Kind("force", "N")
TORQUE = Kind("torque", "N·mm")
PRESSURE = Kind("pressure", "MPa")
AREA = Kind("area", "mm²")
LENGTH = Kind("length", "mm")
ANGLE = Kind("angle", "rad")

# Kind of each quantity by its name; with _ and the name of a patch it is that of this patch alone.
KINDS: dict[str, Kind] = {
    **dict.fromkeys(("tx", "ty", "tz"), LENGTH),
    **dict.fromkeys(("rx", "ry", "rz"), ANGLE),
    **dict.fromkeys(("Fx", "Fy", "Fz", "F"), FORCE),  # F: a magnitude
    **dict.fromkeys(("Tx", "Ty", "Tz"), TORQUE),
    "contact_area": AREA,
    **dict.fromkeys(("mean_pressure", "peak_pressure"), PRESSURE),
    **dict.fromkeys(("gap", "penetration"), LENGTH),
    **dict.fromkeys(("cop_ap", "cop_ml", "cop_x", "cop_y", "cop_z"), LENGTH),  # centre of pressure
}


@dataclass(frozen=True)
class Quantity:
    """A named number: measure is its name without the patch, patch is empty where it holds for all patches."""

    measure: str
    patch: str
    kind: Kind

    @property
    def name(self) -> str:
        """Fy_med."""
        return f"{self.measure}_{self.patch}" if self.patch else self.measure

    @property
    def unit(self) -> str:
        """N."""
        return self.kind.unit

    @property
    def label(self) -> str:
        """Fy_med [N], for axes and tables."""
        return f"{self.name} [{self.unit}]"

    @property
    def column(self) -> str:
        """Fy_med_N, for columns of files."""
        return f"{self.name}_{self.kind.plain_unit}"


def quantity(name: str) -> Quantity:
    """The quantity of this name; raises ValueError for a name that says none, with those there are."""
    if name in KINDS:
        return Quantity(name, "", KINDS[name])
    fitting = [measure for measure in KINDS if name.startswith(f"{measure}_") and len(name) > len(measure) + 1]
    if not fitting:
        raise ValueError(f"unknown quantity {name!r}, expected one of {', '.join(KINDS)}, or that of a patch (Fy_med)")
    measure = max(fitting, key=len)
    return Quantity(measure, name[len(measure) + 1 :], KINDS[measure])


def of_kind(names: Sequence[str], kind: Kind) -> list[str]:
    """Those of the names that are of a kind, in their order."""
    return [name for name in names if quantity(name).kind == kind]


def format_above_limit(value: float, limit: float) -> str:
    """A number in three digits; one above the limit in as many as it takes to print as more than the limit in `:g`."""
    texts = [three_digits(value), *(f"{value:.{digits}g}" for digits in range(4, 18))]
    clear = (text for text in texts if not value > limit or (float(text) > limit and text != f"{limit:g}"))
    return next(clear, texts[-1])


def two_digits(value: float) -> str:
    """A number in two digits, without an exponent from 1e-4 up to a million: 0.94, 27, 180."""
    return f"{float(f'{value:.2g}'):g}"


def three_digits(value: float) -> str:
    """A number in three digits, without an exponent from 1e-4 up to a million: 0.943, 27.1, 1820."""
    return f"{float(f'{value:.3g}'):g}"


def newton_scales(names: Sequence[str], lever_mm: float) -> NDArray[np.float64]:
    """What loads (n,) are divided by to be compared in N: 1 for a force, the lever for a torque; raises ValueError for
    another kind, which no lever makes a force."""
    scales = {FORCE: 1.0, TORQUE: lever_mm}
    for name in names:
        if quantity(name).kind not in scales:
            raise ValueError(f"{name} is a {quantity(name).kind.name}, expected forces and torques to be compared")
    return np.array([scales[quantity(name).kind] for name in names])
