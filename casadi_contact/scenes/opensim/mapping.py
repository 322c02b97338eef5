"""Columns of an OpenSim table as curves in this library's names and units, and results as OpenSim tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.core.quantities import ANGLE, AREA, FORCE, LENGTH, PRESSURE, TORQUE, Kind, quantity
from casadi_contact.scenes.opensim.table import TIME, Table

# Size of a file's unit in the library's, OpenSim's own first.
UNITS: dict[Kind, dict[str, float]] = {
    LENGTH: {"m": 1000.0, "cm": 10.0, "mm": 1.0},
    ANGLE: {"rad": 1.0, "deg": float(np.pi / 180.0)},
    FORCE: {"N": 1.0, "kN": 1000.0},
    TORQUE: {"Nm": 1000.0, "Nmm": 1.0},
    PRESSURE: {"Pa": 1e-6, "MPa": 1.0},
    AREA: {"m2": 1e6, "mm2": 1.0},
}
_FORM = "expected COLUMN=NAME, COLUMN=-NAME or COLUMN=NAME:UNIT, such as knee_angle_r=-rz:deg"


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
        known = UNITS[quantity(self.name).kind]
        if self.unit is not None and self.unit not in known:
            raise ValueError(f"unit {self.unit!r} does not suit {self.name}, expected one of {', '.join(known)}")

    @classmethod
    def parse(cls, text: str) -> ColumnMap:
        """From ``COLUMN=[-]NAME[:UNIT]``; raises ValueError for another form, an unknown name or unit."""
        column, equals, target = text.rpartition("=")
        name, _, unit = target.strip().partition(":")
        bare = name[1:] if name.startswith(("-", "+")) else name
        if not equals or not column.strip() or not bare or bare[0] in "+-" or (":" in target and not unit):
            raise ValueError(f"map {text!r} is not understood, {_FORM}")
        return cls(column.strip(), bare, -1.0 if name.startswith("-") else 1.0, unit or None)

    def curve(self, table: Table) -> Array:
        """The curve (n,) in mm, rad, N or N·mm; raises ValueError where the table lacks the column."""
        kind = quantity(self.name).kind
        own = "deg" if kind == ANGLE and table.in_degrees else _own_unit(kind)
        return self.sign * UNITS[kind][self.unit or own] * table.column(self.column)

    def values(self, curve: Array) -> Array:
        """What a column (n,) in ``unit``, OpenSim's own if None, says of a curve in mm, rad, N or N·mm: `curve`'s
        reverse."""
        kind = quantity(self.name).kind
        return np.asarray(self.sign * curve / UNITS[kind][self.unit or _own_unit(kind)])


def mapped_curves(table: Table, maps: Iterable[ColumnMap]) -> dict[str, Array]:
    """Curves (n,) by name in mm, rad, N, N·mm, and ``time`` [s]; raises ValueError for a name mapped twice."""
    curves = {TIME: table.column(TIME)}
    for item in maps:
        if item.name in curves:
            raise ValueError(f"{item.name} is mapped twice, expected one column for each curve")
        curves[item.name] = item.curve(table)
    return curves


def renamed_table(curves: Mapping[str, Array], maps: Iterable[ColumnMap], name: str) -> Table:
    """Curves (n,) by name in mm, rad, N, N·mm, with their ``time`` [s], as a table of another program's columns: the
    reverse of `mapped_curves`. Its rotations are all in rad or, as the header then says, all in degrees.

    Raises ValueError for a curve that is not there, a column that two maps write, and rotations in both units.
    """
    maps = list(maps)
    missing = [item.name for item in maps if item.name not in curves]
    if missing or TIME not in curves:
        raise ValueError(f"there are no curves {', '.join(missing) or TIME}, expected some of {', '.join(curves)}")
    twice = [item.column for k, item in enumerate(maps) if item.column in {before.column for before in maps[:k]}]
    if twice:
        raise ValueError(f"column {twice[0]} is written twice, expected one curve for each column")
    angles = {item.unit or "rad" for item in maps if quantity(item.name).kind == ANGLE}
    if len(angles) > 1:
        raise ValueError("rotations are mapped to rad and to deg, expected one of them: a file has one inDegrees")
    columns = {item.column: item.values(curves[item.name]) for item in maps}
    return Table(name, {TIME: curves[TIME], **columns}, in_degrees="deg" in angles)


def poses_table(time_s: ArrayLike, poses: ArrayLike, name: str) -> Table:
    """Poses (n, 6) [mm, rad] as an OpenSim table: translations in m, rotations in rad."""
    poses = as_poses(poses)
    return _own_table(time_s, poses, POSE_NAMES, name)


def loads_table(time_s: ArrayLike, loads: Array, load_names: Sequence[str], name: str) -> Table:
    """Loads (n, L) [N, N·mm] as an OpenSim table: forces in N, torques in N·m. Raises ValueError for another shape, and
    for names that do not differ."""
    return _own_table(time_s, loads, load_names, name)


def _own_unit(kind: Kind) -> str:
    """The unit that OpenSim's files have for a kind; angles are in degrees where the file says so."""
    return next(iter(UNITS[kind]))


def _own_table(time_s: ArrayLike, values: Array, names: Sequence[str], title: str) -> Table:
    """Values (n, k) by name, in the library's units, as a table in OpenSim's."""
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != len(names) or len(set(names)) != len(names):
        raise ValueError(
            f"values has shape {values.shape}, expected (n, {len(names)}) of {', '.join(names)}, none twice"
        )
    kinds = [quantity(name).kind for name in names]
    scales = [1.0 / UNITS[kind][_own_unit(kind)] for kind in kinds]
    columns = {name: values[:, k] * scale for k, (name, scale) in enumerate(zip(names, scales, strict=True))}
    return Table(title, {TIME: np.asarray(time_s, dtype=float), **columns}, in_degrees=False)
