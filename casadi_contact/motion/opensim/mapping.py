"""Columns of an OpenSim table as curves in this library's names and units, and results as OpenSim tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import POSE_NAMES, Array, as_poses, is_force
from casadi_contact.motion.opensim.table import TIME, Table

# Size of a file's unit in the library's: mm, N, N·mm, rad.
UNITS = {
    "length": {"m": 1000.0, "cm": 10.0, "mm": 1.0},
    "angle": {"rad": 1.0, "deg": float(np.pi / 180.0)},
    "force": {"N": 1.0, "kN": 1000.0},
    "torque": {"Nm": 1000.0, "Nmm": 1.0},
}
_LOAD = re.compile(r"[FT][xyz](_\w+)?")
_FORM = "expected COLUMN=NAME, COLUMN=-NAME or COLUMN=NAME:UNIT, such as knee_angle_r=-rz:deg"


def kind_of(name: str) -> str:
    """What a curve measures, by its name: length (tx, cop_ap), angle (rz), force (Fy_med) or torque (Tz)."""
    if name in POSE_NAMES:
        return "length" if name.startswith("t") else "angle"
    if name in ("cop_ap", "cop_ml"):
        return "length"
    if _LOAD.fullmatch(name):
        return "force" if is_force(name) else "torque"
    known = ", ".join((*POSE_NAMES, "cop_ap", "cop_ml"))
    raise ValueError(f"unknown curve {name!r}, expected one of {known}, or a load such as Fy_med or Tz")


@dataclass(frozen=True)
class ColumnMap:
    """A table's column that becomes the curve `name`: sign · value, in `unit`.

    unit None is the file's own: m, N, N·m, and rad or degrees as inDegrees says.
    """

    column: str
    name: str
    sign: float = 1.0
    unit: str | None = None

    def __post_init__(self) -> None:
        known = UNITS[kind_of(self.name)]
        if self.unit is not None and self.unit not in known:
            raise ValueError(f"unit {self.unit!r} does not suit {self.name}, expected one of {', '.join(known)}")

    @classmethod
    def parse(cls, text: str) -> ColumnMap:
        """From ``COLUMN=[-]NAME[:UNIT]``; raises ValueError for another form, an unknown name or unit."""
        column, equals, target = text.rpartition("=")
        name, _, unit = target.strip().partition(":")
        if not equals or not column.strip() or not name or (":" in target and not unit):
            raise ValueError(f"map {text!r} is not understood, {_FORM}")
        return cls(column.strip(), name.lstrip("-+"), -1.0 if name.startswith("-") else 1.0, unit or None)

    def curve(self, table: Table) -> Array:
        """The curve (n,) in mm, rad, N or N·mm; raises ValueError where the table lacks the column."""
        kind = kind_of(self.name)
        own = {"length": "m", "angle": "deg" if table.in_degrees else "rad", "force": "N", "torque": "Nm"}
        return self.sign * UNITS[kind][self.unit or own[kind]] * table.column(self.column)


def mapped_curves(table: Table, maps: Iterable[ColumnMap]) -> dict[str, Array]:
    """Curves (n,) by name in mm, rad, N, N·mm, and ``time`` [s]; raises ValueError for a name mapped twice."""
    curves = {TIME: table.column(TIME)}
    for item in maps:
        if item.name in curves:
            raise ValueError(f"{item.name} is mapped twice, expected one column for each curve")
        curves[item.name] = item.curve(table)
    return curves


def poses_table(time_s: ArrayLike, poses: ArrayLike, name: str) -> Table:
    """Poses (n, 6) [mm, rad] as an OpenSim table: translations in m, rotations in rad."""
    poses = as_poses(poses)
    scales = [1.0 / UNITS["length"]["m"] if kind_of(key) == "length" else 1.0 for key in POSE_NAMES]
    columns = {key: poses[:, column] * scales[column] for column, key in enumerate(POSE_NAMES)}
    return Table(name, {TIME: np.asarray(time_s, dtype=float), **columns}, in_degrees=False)


def loads_table(time_s: ArrayLike, loads: Array, load_names: Sequence[str], name: str) -> Table:
    """Loads (n, L) [N, N·mm] as an OpenSim table: forces in N, torques in N·m."""
    scales = [1.0 if is_force(key) else 1.0 / UNITS["torque"]["Nm"] for key in load_names]
    columns = {key: loads[:, column] * scales[column] for column, key in enumerate(load_names)}
    return Table(name, {TIME: np.asarray(time_s, dtype=float), **columns}, in_degrees=False)
