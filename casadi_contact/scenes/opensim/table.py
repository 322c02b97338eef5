"""OpenSim's .mot and .sto files: a header, a line of labels, and rows of numbers that begin with time.

name                    the first line, where it is neither key=value nor endheader
version=1               1 to 3; also nRows, nColumns, inDegrees=yes|no, DataType=double, ...
datarows 101            as SIMM and old files say nRows=101; datacolumns likewise
any text                comments are kept
endheader
time  label  label ...  tabs or spaces
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_TEXT, checked_size, existing_file, finite_number
from casadi_contact.core.files.writing import replacing

TIME = "time"
VERSIONS = (1, 2, 3)
_KEY_AND_VALUE = re.compile(r"([A-Za-z]\w*)(?:\s*=|(?<=\bdatarows)\s|(?<=\bdatacolumns)\s)\s*(.*)")
_COUNTED = ("version", "nRows", "nColumns", "inDegrees")  # header keys that `Table` holds in another form
_KNOWN_KEYS = {key.lower(): key for key in _COUNTED}  # files write them in small letters too
_KNOWN_KEYS |= {"datarows": "nRows", "datacolumns": "nColumns"}
_WORDS = {"yes": True, "no": False, "true": True, "false": False}


@dataclass(frozen=True)
class Table:
    """Columns (n,) by label, the first of them ``time`` [s], as the file has them: no unit is converted.

    in_degrees says what the file says of its rotations, None where it says nothing (they are then in rad); header
    holds further key=value lines, notes the header's free text. Raises ValueError for labels or columns that no file
    can hold.
    """

    name: str
    columns: Mapping[str, Array]
    in_degrees: bool | None = None
    version: int = 1
    header: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.version not in VERSIONS:
            raise ValueError(f"version is {self.version}, expected one of {VERSIONS}")
        if next(iter(self.columns), None) != TIME:
            raise ValueError(f"the first column is {next(iter(self.columns), None)!r}, expected {TIME!r}")
        for label in self.columns:
            if not label or label != label.strip() or "\t" in label or len(label.splitlines()) > 1:
                raise ValueError(f"column label {label!r} is empty or holds tabs, line ends or outer spaces")
        checked = {label: _checked_column(label, curve) for label, curve in self.columns.items()}
        lengths = {label: len(curve) for label, curve in checked.items()}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"columns have different lengths: {lengths}")
        object.__setattr__(self, "columns", checked)
        for line in (self.name, *self.notes, *(f"{key}={value}" for key, value in self.header.items())):
            if line != line.strip() or len(line.splitlines()) > 1 or line.lower() == "endheader":
                raise ValueError(f"header line {line!r} is not one line of text")
        for key, value in self.header.items():
            is_pair = _KEY_AND_VALUE.fullmatch(f"{key}={value}") is not None
            if key.lower() in _KNOWN_KEYS or not is_pair or value != value.strip():
                raise ValueError(f"header entry {key}={value} cannot stand in a file, expected a word and a value")
        for text in (self.name, *self.notes):
            if _KEY_AND_VALUE.fullmatch(text):
                raise ValueError(f"{text!r} reads as key=value, expected plain text: put it in header")
        if "" in self.notes:
            raise ValueError("a note is empty, expected text")

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
    header without end, an unknown version, a label that is missing or there twice, a ragged row, NaN, text among the
    numbers, or fewer rows than the header promises.
    """
    path = existing_file(path, expected="a .mot or .sto file")
    checked_size(path, MOST_TEXT)
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} is not a text file in UTF-8 ({error}), expected a .mot or .sto file: save it as text"
        ) from None
    ends = [number for number, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise ValueError(f"{path} has no line 'endheader', expected a .mot or .sto file")
    name, header, notes = _read_header(path, lines[: ends[0]])
    counts = {
        key: _whole_number(path, key, header.pop(key)) for key in ("version", "nRows", "nColumns") if key in header
    }
    degrees = header.pop("inDegrees", None)
    if degrees is not None and degrees.lower() not in _WORDS:
        raise ValueError(f"{path}: inDegrees is {degrees!r}, expected yes or no")
    body = [(number, line) for number, line in enumerate(lines[ends[0] + 1 :], start=ends[0] + 2) if line.strip()]
    if not body:
        raise ValueError(f"{path} ends after its header, expected a line of labels and rows of numbers")
    labels = _read_labels(path, *body[0])
    if counts.get("nColumns", len(labels)) != len(labels):
        raise ValueError(f"{path} line {body[0][0]}: {len(labels)} labels, but nColumns={counts['nColumns']}")
    rows = [_read_row(path, number, line, labels) for number, line in body[1:]]
    if counts.get("nRows", len(rows)) != len(rows):
        raise ValueError(
            f"{path} line {body[-1][0]}: the file ends after {len(rows)} rows, but nRows={counts['nRows']}: truncated?"
        )
    values = np.array(rows, dtype=np.float64).reshape(len(rows), len(labels))
    columns = {label: values[:, column] for column, label in enumerate(labels)}
    try:
        in_degrees = None if degrees is None else _WORDS[degrees.lower()]
        return Table(name, columns, in_degrees, counts.get("version", 1), header, notes)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_table(table: Table, path: str | Path) -> None:
    """Write a .mot or .sto file, tabs between columns, numbers so that reading gives the same bits back."""
    head = [table.name] if table.name else []
    head += [f"version={table.version}", f"nRows={len(table)}", f"nColumns={len(table.columns)}"]
    if table.in_degrees is not None:
        head.append(f"inDegrees={'yes' if table.in_degrees else 'no'}")
    head += [*(f"{key}={value}" for key, value in table.header.items()), *table.notes]
    rows = np.column_stack(list(table.columns.values())).tolist()
    body = ["\t".join(table.columns), *("\t".join(map(repr, row)) for row in rows)]
    with replacing(Path(path)) as beside:
        beside.write_text("\n".join([*head, "endheader", *body, ""]), "utf-8")


def _read_header(path: Path, lines: list[str]) -> tuple[str, dict[str, str], tuple[str, ...]]:
    """Name, key=value lines and other text of the lines before endheader."""
    name, notes = "", []
    header: dict[str, str] = {}
    for number, line in enumerate(text.strip() for text in lines):
        pair = _KEY_AND_VALUE.fullmatch(line)
        if pair:
            key = _KNOWN_KEYS.get(pair[1].lower(), pair[1])
            if key in _COUNTED and header.get(key, pair[2]) != pair[2]:
                raise ValueError(
                    f"{path} line {number + 1}: {key} is {header[key]!r} and {pair[2]!r}, expected one of them"
                )
            header[key] = pair[2]
        elif number == 0:
            name = line
        elif line:
            notes.append(line)
    return name, header, tuple(notes)


def _whole_number(path: Path, key: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{path}: {key} is {text!r}, expected a whole number") from None


def _read_labels(path: Path, number: int, line: str) -> list[str]:
    labels = [label.strip() for label in (line.rstrip("\t").split("\t") if "\t" in line else line.split())]
    if labels[0].lower() != TIME:
        raise ValueError(f"{path} line {number}: the first label is {labels[0]!r}, expected {TIME!r}")
    labels[0] = TIME
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise ValueError(f"{path} line {number}: the column {twice[0]!r} is there twice")
    return labels


def _read_row(path: Path, number: int, line: str, labels: list[str]) -> list[float]:
    words = line.split()
    if any(word.count(",") > 1 for word in words):
        raise ValueError(f"{path} line {number} has vectors (DataType), expected a number for each label: save scalars")
    if len(words) != len(labels):
        raise ValueError(f"{path} line {number}: got {len(words)} values, expected {len(labels)}")
    return [finite_number(word, f"{path} line {number}, {label}") for label, word in zip(labels, words, strict=True)]
