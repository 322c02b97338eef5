"""OpenSim's .mot and .sto files: a header, a line of labels, and rows of numbers that begin with time.

name                    the first line, where it is not key=value
version=1               nRows, nColumns and inDegrees=yes|no are read, other keys and comments skipped
datarows 101            as SIMM and old files say nRows=101; datacolumns likewise
endheader
time  label  label ...  tabs or spaces
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_TEXT, checked_size, existing_file, finite_number
from casadi_contact.core.files.writing import write_text

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
        for label in self.columns:
            if not label or label != label.strip() or "\t" in label or len(label.splitlines()) > 1:
                raise ValueError(f"column label {label!r} is empty or holds tabs, line ends or outer spaces")
        checked = {label: _checked_column(label, curve) for label, curve in self.columns.items()}
        if len({len(curve) for curve in checked.values()}) != 1:
            raise ValueError(f"columns have different lengths: { {k: len(v) for k, v in checked.items()} }")
        object.__setattr__(self, "columns", checked)

    def __len__(self) -> int:
        return len(self.columns[TIME])

    def column(self, label: str) -> Array:
        """A column by its label; raises ValueError naming the labels there are."""
        if label not in self.columns:
            raise ValueError(f"table {self.name!r} has no column {label!r}; it has {', '.join(self.columns)}")
        return self.columns[label]


def _checked_column(label: str, curve: ArrayLike) -> Array:
    array = np.asarray(curve, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError(f"column {label!r} of shape {array.shape} is not a row of finite numbers")
    return array


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
    for keys, got, line in (
        (("nrows", "datarows"), len(rows), body[-1][0]),
        (("ncolumns", "datacolumns"), len(labels), body[0][0]),
    ):
        for key in keys:
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
