"""OpenSim's .mot and .sto files, and their columns as curves in this library's names and units, there and back.

name                    the first line, where it is not key=value
version=1               nRows, nColumns and inDegrees=yes|no are read, other keys and comments skipped
datarows 101            as SIMM and old files say nRows=101; datacolumns likewise
endheader
time  label  label ...  tabs or spaces
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import POSE_NAMES, Array, as_poses
from casadi_contact.core.files.reading import MOST_TEXT, checked_size, existing_file, finite_number
from casadi_contact.core.files.writing import write_text
from casadi_contact.core.quantities import ANGLE, AREA, FORCE, LENGTH, PRESSURE, TORQUE, Kind, quantity

TIME = "time"
_PAIR = re.compile(r"([A-Za-z]\w*)(?:\s*=|(?<=\bdatarows)\s|(?<=\bdatacolumns)\s)\s*(.*)")
_DEGREES = {"yes": True, "true": True, "no": False, "false": False}


@dataclass(frozen=True)
class Table:
    """Columns (n,) by label, the first of them ``time`` [s], in the file's own units.

    in_degrees: the unit of rotations that the file names, None where it names none (they are then in rad). Raises
    ValueError for labels or columns that no file can hold.
    """

    name: str
    columns: Mapping[str, Array]
    in_degrees: bool | None = None

    def __post_init__(self) -> None:
        if next(iter(self.columns), None) != TIME:
            raise ValueError(f"the first column is {next(iter(self.columns), None)!r}, expected {TIME!r}")
        checked = {label: np.asarray(curve, dtype=np.float64) for label, curve in self.columns.items()}
        for label, curve in checked.items():
            if not label or label != label.strip() or "\t" in label or len(label.splitlines()) > 1:
                raise ValueError(f"column label {label!r} is empty or holds tabs, line ends or outer spaces")
            if curve.shape != checked[TIME].shape or curve.ndim != 1 or not np.isfinite(curve).all():
                raise ValueError(
                    f"column {label!r} of shape {curve.shape}, expected finite numbers for {checked[TIME].shape} times"
                )
        object.__setattr__(self, "columns", checked)

    def __len__(self) -> int:
        return len(self.columns[TIME])

    def column(self, label: str) -> Array:
        """A column by its label; raises ValueError naming the labels there are."""
        if label not in self.columns:
            raise ValueError(f"table {self.name!r} has no column {label!r}; it has {', '.join(self.columns)}")
        return self.columns[label]


def read_opensim_table(path: str | Path) -> Table:
    """Read a .mot or .sto file.

    Raises FileNotFoundError for no file, and ValueError naming file and line for text that is not such a file, a
    header without end, a missing or repeated label, a ragged row, anything but finite numbers, or fewer rows than the
    header promises.
    """
    path = existing_file(path, expected="a .mot or .sto file")
    checked_size(path, MOST_TEXT)
    try:
        lines = [line.strip() for line in path.read_text("utf-8-sig").splitlines()]
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file in UTF-8 ({error}), expected a .mot or .sto file") from None
    end = next((number for number, line in enumerate(lines) if line.lower() == "endheader"), None)
    if end is None:
        raise ValueError(f"{path} has no line 'endheader', expected a .mot or .sto file")
    header = {pair[1].lower(): pair[2] for line in lines[:end] if (pair := _PAIR.fullmatch(line))}
    degrees = header.get("indegrees")
    if degrees is not None and degrees.lower() not in _DEGREES:
        raise ValueError(f"{path}: inDegrees is {degrees!r}, expected yes or no")
    body = [(number, line) for number, line in enumerate(lines[end + 1 :], start=end + 2) if line]
    if not body:
        raise ValueError(f"{path} ends after its header, expected a line of labels and rows of numbers")
    labels = _labels(path, *body[0])
    rows = [_row(path, number, line, labels) for number, line in body[1:]]
    for what, got, line in (("rows", len(rows), body[-1][0]), ("columns", len(labels), body[0][0])):
        for key in (f"n{what}", f"data{what}"):
            if header.get(key, str(got)) != str(got):
                raise ValueError(f"{path} line {line}: {key} is {header[key]}, but there are {got}: truncated?")
    values = np.array(rows, dtype=np.float64).reshape(len(rows), len(labels))
    name = "" if not lines[:end] or _PAIR.fullmatch(lines[0]) else lines[0]
    try:
        columns = {label: values[:, k] for k, label in enumerate(labels)}
        return Table(name, columns, None if degrees is None else _DEGREES[degrees.lower()])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_table(table: Table, path: str | Path) -> None:
    """Write a .mot or .sto file, tabs between columns, with numbers that read back bit by bit."""
    head = [table.name, "version=1", f"nRows={len(table)}", f"nColumns={len(table.columns)}"]
    if table.in_degrees is not None:
        head.append(f"inDegrees={'yes' if table.in_degrees else 'no'}")
    rows = np.column_stack(list(table.columns.values())).tolist()
    body = ["\t".join(table.columns), *("\t".join(map(repr, row)) for row in rows)]
    write_text(Path(path), "\n".join([*head, "endheader", *body, ""]))


def _labels(path: Path, number: int, line: str) -> list[str]:
    labels = [label.strip() for label in (line.split("\t") if "\t" in line else line.split())]
    if labels[0].lower() != TIME:
        raise ValueError(f"{path} line {number}: the first label is {labels[0]!r}, expected {TIME!r}")
    labels[0] = TIME
    if len(set(labels)) != len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise ValueError(f"{path} line {number}: the column {twice!r} is there twice")
    return labels


def _row(path: Path, number: int, line: str, labels: list[str]) -> list[float]:
    words = line.split()
    if any(word.count(",") > 1 for word in words):
        raise ValueError(f"{path} line {number} has vectors (DataType), expected a number for each label: save scalars")
    if len(words) != len(labels):
        raise ValueError(f"{path} line {number}: got {len(words)} values, expected {len(labels)}")
    return [finite_number(word, f"{path} line {number}, {label}") for label, word in zip(labels, words, strict=True)]


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
    curves = {TIME: np.asarray(time_s, dtype=float), **dict(zip(POSE_NAMES, as_poses(poses).T, strict=True))}
    return renamed_table(curves, [ColumnMap(each, each) for each in POSE_NAMES], name)


def _own_unit(kind: Kind) -> str:
    """The unit that OpenSim's files have for a kind; angles are in degrees where the file says so."""
    return next(iter(UNITS[kind]))
