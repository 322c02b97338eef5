"""OpenSim's .mot and .sto files, and their columns as curves in this library's names and units, there and back.

name                    the first line, where it is not key=value
version=1               rows, columns and degrees are read, other keys and comments skipped
datarows 101            as SIMM and old files say nRows=101; datacolumns likewise, nr and nc
Angles are in degrees.  as old files say inDegrees=yes; SIMM's own (.mot before version 1) need not
endheader
time  label  label ...  tabs, commas or spaces; quotes and empty cells of a spreadsheet are skipped
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.core.files.reading import MOST_TEXT, checked_size, existing_file, finite_number
from casadi_contact.core.files.writing import write_text
from casadi_contact.core.quantities import ANGLE, AREA, FORCE, LENGTH, PRESSURE, TORQUE, Kind, quantity

TIME = "time"
_ROWS, _COLUMNS = ("nrows", "nr", "datarows"), ("ncolumns", "nc", "datacolumns")
_PAIR = re.compile(rf"(?i)([a-z]\w*)\s*=\s*(.*)|({'|'.join((*_ROWS, *_COLUMNS))}|version|indegrees)\s+(\S+)")
_ANGLES = re.compile(r"(?i)angles?\s+(?:are\s+)?in\s+(deg|rad)")
_DEGREES = {"yes": True, "y": True, "true": True, "1": True, "no": False, "n": False, "false": False, "0": False}


@dataclass(frozen=True)
class Table:
    """Columns (n,) by label, the first of them ``time`` [s], in the file's own units. in_degrees: the unit of rotations
    that the file names, None where it names none or both (they are then in rad). Cells may be NaN. Raises ValueError
    for labels or columns that no file can hold."""

    name: str
    columns: Mapping[str, Array]
    in_degrees: bool | None = None

    def __post_init__(self) -> None:
        if next(iter(self.columns), None) != TIME:
            raise ValueError(f"the first column is {next(iter(self.columns), None)!r}, expected {TIME!r}")
        checked = {label: np.asarray(curve, dtype=np.float64) for label, curve in self.columns.items()}
        for label, curve in checked.items():
            if not label or label != label.strip().strip(",;") or {*'"\t'} & {*label} or len(label.splitlines()) > 1:
                raise ValueError(f"column label {label!r} is empty or holds tabs, line ends, quotes or outer spaces")
            if curve.shape != checked[TIME].shape or curve.ndim != 1:
                raise ValueError(f"column {label!r} has shape {curve.shape}, expected {checked[TIME].shape}, as time")
        object.__setattr__(self, "columns", checked)

    def __len__(self) -> int:
        return len(self.columns[TIME])

    def column(self, label: str) -> Array:
        """A column of finite numbers by its label; raises ValueError naming the labels there are, or the row."""
        if label not in self.columns:
            raise ValueError(f"table {self.name!r} has no column {label!r}; it has {', '.join(self.columns)}")
        if not (finite := np.isfinite(self.columns[label])).all():
            raise ValueError(f"column {label!r} has no finite number in row {finite.argmin() + 1} of {len(self)}")
        return self.columns[label]


def read_opensim_table(path: str | Path) -> Table:
    """Read a .mot or .sto file. A label that is there more than once gets its column's number. Warns of counts in the
    header that are off. Raises FileNotFoundError for no file, and ValueError naming file and line for text that is not
    such a file, a header without end, a missing label, a ragged row, or anything but numbers."""
    path = existing_file(path, expected="a .mot or .sto file")
    checked_size(path, MOST_TEXT)
    text = path.read_text("utf-8-sig", errors="replace").replace('"', "")
    lines = [line.strip(" \t,;") for line in text.splitlines()]
    end = next((number for number, line in enumerate(lines) if line.lower() == "endheader"), None)
    if end is None:
        raise ValueError(f"{path} has no line 'endheader', expected a .mot or .sto file")
    pairs = [pair for line in lines[:end] if (pair := _PAIR.fullmatch(line))]
    header = {(pair[1] or pair[3]).lower(): pair[2] or pair[4] or "" for pair in pairs}
    body = [(number, line) for number, line in enumerate(lines[end + 1 :], start=end + 2) if line]
    if not body:
        raise ValueError(f"{path} ends after its header, expected a line of labels and rows of numbers")
    (first, head), *rows = body
    cut = next((mark for mark in "\t;," if mark in head), None)
    labels = [label.strip() for label in head.split(cut) if label.strip()]
    if labels[0].lower() != TIME:
        raise ValueError(f"{path} line {first}: the first label is {labels[0]!r}, expected {TIME!r}")
    labels = [f"{each} (column {k})" if labels.count(each) > 1 else each for k, each in enumerate(labels, start=1)]
    values = np.array([_row(path, number, line.replace(cut or " ", " "), labels) for number, line in rows])
    for keys, got in ((_ROWS, len(rows)), (_COLUMNS, len(labels))):
        for key in set(keys) & set(header):
            if header[key] != str(got):
                warnings.warn(f"{path}: {key} is {header[key]}, but there are {got}: truncated?", stacklevel=2)
    name = "" if not lines[:end] or _PAIR.fullmatch(lines[0]) else lines[0]
    columns = dict(zip([TIME, *labels[1:]], values.reshape(len(rows), len(labels)).T, strict=True))
    try:
        return Table(name, columns, _in_degrees(header, lines[:end], path.suffix.lower()))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _in_degrees(header: Mapping[str, str], lines: Iterable[str], ending: str) -> bool | None:
    """What a header says of angles, as OpenSim reads it (Storage::parseHeaders); None: nothing, or both."""
    if (value := header.get("indegrees", "no").lower()) not in _DEGREES:
        raise ValueError(f"inDegrees is {value!r}, expected yes or no")
    said = {match[1].lower() == "deg" for line in lines if (match := _ANGLES.match(line))}
    if "indegrees" in header:
        said.add(_DEGREES[value])
    simm = ending == ".mot" and header.get("version", "0").startswith("0")
    return said.pop() if len(said) == 1 else (simm and not said) or None


def write_table(table: Table, path: str | Path) -> None:
    """Write a .mot or .sto file, tabs between columns, with numbers that read back bit by bit."""
    head = [table.name, "version=1", f"nRows={len(table)}", f"nColumns={len(table.columns)}"]
    if table.in_degrees is not None:
        head.append(f"inDegrees={'yes' if table.in_degrees else 'no'}")
    rows = np.column_stack(list(table.columns.values())).tolist()
    body = ["\t".join(table.columns), *("\t".join(map(repr, row)) for row in rows)]
    write_text(Path(path), "\n".join([*head, "endheader", *body, ""]))


def _row(path: Path, number: int, line: str, labels: list[str]) -> list[float]:
    words = line.split()
    if any(word.count(",") > 1 for word in words):
        raise ValueError(f"{path} line {number} has vectors (DataType), expected a number for each label: save scalars")
    if len(words) != len(labels):
        raise ValueError(f"{path} line {number}: got {len(words)} values, expected {len(labels)}")
    return [
        math.nan if "nan" in word.lower() or "1.#" in word else finite_number(word, f"{path} line {number}, {label}")
        for label, word in zip(labels, words, strict=True)
    ]


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
    """A table's column that becomes the curve `name`: sign · value in `unit`; None: the file's own (m, N, N·m)."""

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
        own = "deg" if kind == ANGLE and table.in_degrees else next(iter(UNITS[kind]))
        return self.sign * UNITS[kind][self.unit or own] * table.column(self.column)

    def values(self, curve: Array) -> Array:
        """The column (n,) in ``unit``, OpenSim's own if None, of a curve in mm, rad, N or N·mm: `curve`'s reverse."""
        kind = quantity(self.name).kind
        return np.asarray(self.sign * curve / UNITS[kind][self.unit or next(iter(UNITS[kind]))])


def mapped_curves(table: Table, maps: Iterable[ColumnMap]) -> dict[str, Array]:
    """Curves (n,) by name in mm, rad, N, N·mm, and ``time`` [s]; raises ValueError for a name mapped twice."""
    curves, maps = {TIME: table.column(TIME)}, list(maps)
    angles = [item.column for item in maps if quantity(item.name).kind == ANGLE and item.unit is None]
    if angles and table.in_degrees is None:
        warnings.warn(
            f"the file says neither degrees nor radians, or both: {', '.join(angles)} are taken in rad; where they are "
            "in degrees, write inDegrees=yes in its header, or COLUMN=NAME:deg",
            stacklevel=2,
        )
    for item in maps:
        if item.name in curves:
            raise ValueError(f"{item.name} is mapped twice, expected one column for each curve")
        curves[item.name] = item.curve(table)
    return curves


def renamed_table(curves: Mapping[str, Array], maps: Iterable[ColumnMap], name: str) -> Table:
    """Curves (n,) by name in mm, rad, N, N·mm, with their ``time`` [s], as a table of another program's columns: the
    reverse of `mapped_curves`. Its rotations are all in rad or, as the header then says, all in degrees. Raises
    ValueError for a curve that is not there, a column that two maps write, and rotations in both units."""
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
    curves = {TIME: np.asarray(time_s, dtype=float), **dict(zip(POSE_NAMES, as_poses(poses).T, strict=True))}
    return renamed_table(curves, [ColumnMap(each, each) for each in POSE_NAMES], name)


SIDES = ("right", "left")
_TURN = np.array([-1.0, 1.0, -1.0])  # by 180 degrees about y: x anterior, z lateral to x posterior, z medial
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])  # in the plane z = 0: a vector, then turns about x, y, z


def femur_in_insert(coordinates: ArrayLike, side: str = "right") -> Array:
    """Poses (n, 6) [mm, rad] of the femur in the insert, from knee coordinates of OpenSim: the tibia in the femur.

    coordinates (n, 6): knee_tx, knee_ty, knee_tz [mm], knee_add, knee_rot, knee_flex [rad], x anterior, y superior, z
    to the right. Of a right knee, adduction, internal rotation and flexion are positive. The tibia's frame is the
    insert's but for the turn; its points q lie at t + Rz(-flex)·Rx(add)·Ry(rot)·q in the femur (the CustomJoint of
    Lenhart et al., Ann Biomed Eng 43 (2015) 2675-2685). With C the turn about y by 180 degrees the pose is

        R = C·(Rz(-flex)·Rx(add)·Ry(rot))ᵀ·C = Ry(-rot)·Rx(add)·Rz(-flex),   translation -R·C·t.

    side: "left" is the mirror image of a right knee, which scenes are made for (`Placement.mirror`): knee_tz, knee_add
    and knee_rot about the same axes as of a right one change sign. Raises ValueError for another side. Joints that
    count a coordinate the other way (knee_angle < 0 in flexion; a left knee's axes written -1 0 0, 0 -1 0) need its
    sign turned before.

    >>> femur_in_insert([[5.0, -27.0, 1.0, 0.02, 0.1, 0.3]]).round(3).tolist()
    [[12.544, 24.292, 2.752, 0.02, -0.1, -0.298]]
    """
    q = as_poses(coordinates) * _mirror(side)
    turns = Rotation.from_euler("YXZ", q[:, [4, 3, 5]] * _TURN)
    return np.column_stack([-turns.apply(_TURN * q[:, :3]), turns.as_euler("XYZ")])


def tibia_in_femur(poses: ArrayLike, side: str = "right") -> Array:
    """Knee coordinates (n, 6) [mm, rad] of OpenSim from poses (n, 6): the reverse of `femur_in_insert`."""
    poses = as_poses(poses)
    turns = Rotation.from_euler("XYZ", poses[:, 3:])
    rot, add, flex = (turns.as_euler("YXZ") * _TURN).T
    return np.column_stack([-_TURN * turns.inv().apply(poses[:, :3]), add, rot, flex]) * _mirror(side)


def _mirror(side: str) -> Array:
    if side not in SIDES:
        raise ValueError(f"side is {side!r}, expected {' or '.join(SIDES)}")
    return _MIRROR if side == "left" else np.ones(6)
