"""Columns by name from a CSV file and into one, and checks of what they hold."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.reading import MOST_TEXT, checked_size, existing_file, finite_number, short
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.quantities import ANGLE, LENGTH, Kind, quantity

_MOST: dict[Kind, tuple[float, str]] = {
    ANGLE: (3.5, "radians: is it in degrees"),
    LENGTH: (1000.0, "mm below 1 m: is the file in mm"),
}


@dataclass(frozen=True)
class TextColumns:
    """Columns of a CSV file as text, before they are known to be numbers: header, and rows with their line numbers."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]

    @classmethod
    def read(cls, path: str | Path, what: str = "file") -> TextColumns:
        """Read a file; what names it in messages. Lines without any text are skipped, as other readers do, rows of
        empty cells at the end, and lines above the header with less than half of its cells. Raises FileNotFoundError
        for no file, and ValueError, naming file and line, for what is no CSV text, ragged rows, a row of empty cells
        before a full one, and a file without rows."""
        path = existing_file(path, what, "a CSV file")
        checked_size(path, MOST_TEXT)
        rows: list[tuple[int, list[str]]] = []
        lost = 0
        try:
            with path.open(newline="", encoding="utf-8-sig") as file:
                lines = csv.reader(file)
                for row in lines:
                    number = lines.line_num  # a quoted cell may hold the end of a line
                    if not any(cell.strip() for cell in row):
                        lost = lost or (number if len(row) > 1 else 0)
                        continue
                    if lost:
                        raise ValueError(f"{path} line {lost} has empty cells, expected numbers: is a frame missing?")
                    rows.append((number, row))
        except UnicodeDecodeError as error:
            raise ValueError(f"{path} is not a CSV text file in UTF-8 ({error}): save it as CSV UTF-8") from None
        except csv.Error as error:
            raise ValueError(f"{path} is not a CSV text file ({error})") from None
        while len(rows) > 1 and 2 * len(rows[0][1]) < len(rows[1][1]) and ";" not in rows[0][1][0]:
            del rows[0]  # a title or comment above the header
        if not rows:
            raise ValueError(f"{path} is empty, expected a header and rows")
        if len(rows) == 1:
            raise ValueError(f"{path} has a header only, expected rows below it")
        header = tuple(name.strip(" #\t") for name in rows[0][1])
        if any("\0" in name for name in header):
            raise ValueError(f"{path} is not a CSV text file in UTF-8 (in UTF-16?): save it as CSV UTF-8")
        if len(header) == 1 and (delimiter := next((c for c in ";\t" if c in rows[0][1][0]), "")):
            what = "semicolons" if delimiter == ";" else "tabs"
            raise ValueError(f"{path} has {what} between its columns, expected commas (and points in numbers)")
        for line, row in rows[1:]:
            if len(row) != len(header):
                commas = ": are there commas in numbers?" if len(row) == 2 * len(header) else ""
                raise ValueError(f"{path} line {line}: got {len(row)} values, expected {len(header)}{commas}")
        return cls(path, header, tuple((line, tuple(cell.strip() for cell in row)) for line, row in rows[1:]))

    def require(self, *names: str) -> None:
        """ValueError naming the columns that the file lacks, and those that it has."""
        missing = [name for name in names if name not in self.header]
        if missing:
            which = f"columns {', '.join(missing)}" if len(names) > 1 else f"column {missing[0]}"
            raise ValueError(f"{self.path} lacks the {which}; it has {short(', '.join(self.header))}")

    def text(self, name: str) -> list[str]:
        """A column (n,) as it stands; ValueError where the file lacks it or has it more than once."""
        self.require(name)
        if self.header.count(name) > 1:
            raise ValueError(f"{self.path} has the column {name} more than once")
        place = self.header.index(name)
        return [row[place] for _, row in self.rows]

    def numbers(self, name: str) -> Array:
        """A column (n,) of finite numbers; ValueError likewise, and naming line and column of anything else."""
        numbers = np.empty(len(self.rows))
        for k, cell in enumerate(self.text(name)):
            numbers[k] = finite_number(cell, f"{self.path} line {self.rows[k][0]}, {name}")
        return numbers


def read_columns(
    path: str | Path, *, required: Sequence[str], optional: Sequence[str] = (), what: str = "file"
) -> dict[str, Array]:
    """The required columns and those of the optional ones that the file has, each (n,); others are ignored. what names
    the file in messages. Raises FileNotFoundError and ValueError as `TextColumns` does."""
    table = TextColumns.read(path, what)
    table.require(*required)
    return {name: table.numbers(name) for name in (*required, *optional) if name in table.header}


def write_columns(
    path: str | Path, columns: Mapping[str, Sequence[Any] | np.ndarray], *, digits: int | None = None
) -> None:
    """Write columns of one length as a CSV file with a header, whole or not at all. Floating-point numbers get so many
    digits, or as many as `read_columns` needs to read the same bits if left out; anything else its text."""

    def text(value: Any) -> str:
        if not isinstance(value, float | np.floating):
            return str(value)
        return repr(float(value)) if digits is None else f"{value:.{digits}g}"

    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of a table have different lengths: {lengths}")
    with replacing(Path(path)) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([text(value) for value in row] for row in zip(*columns.values(), strict=True))


# Checks of curves over time: finite numbers, rising times, and the sizes that a joint's angles and lengths have.
# where: the file or cycle that messages begin with.


def check_reach(where: str, curves: Mapping[str, Array]) -> None:
    """ValueError for angles beyond 200 degrees and lengths beyond 1 m, in other units, among curves (n,) by name."""
    for name, curve in curves.items():
        most, cure = _MOST.get(quantity(name).kind, (np.inf, ""))
        if (reached := float(np.abs(curve).max())) > most:
            raise ValueError(f"{where}: {name} reaches {reached:g}, expected {cure}?")


def check_size(where: str, column: str, numbers: Array, largest: float = 1e15) -> None:
    """ValueError for numbers (n,) beyond 1e15, which other programs write for a missing value."""
    if (large := np.abs(numbers) > largest).any():
        row = int(large.argmax())
        raise ValueError(f"{where}: {column} is {numbers[row]:g} in row {row + 1}: remove rows of missing values")


def check_rising(where: str, time_s: Array) -> None:
    """ValueError for times (n,) [s] of fewer than 2 frames, or that do not rise."""
    if len(time_s) < 2:
        raise ValueError(f"{where} has {len(time_s)} frames, expected at least 2")
    if np.any(still := np.diff(time_s) <= 0.0):
        frame = int(still.argmax()) + 1
        raise ValueError(f"{where}: time does not rise at frame {frame}, {time_s[frame]:g} s: sort rows, drop repeats")


def checked_curves(cycle: str, curves: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Curves (n,) of a cycle by name, time_s [s] among them, as arrays; raises ValueError as the checks above do."""
    count = len(np.atleast_1d(curves["time_s"]))
    checked: dict[str, Array] = {}
    for key, given in curves.items():
        curve: Array = np.ma.filled(np.ma.array(given, dtype=float), np.nan)  # masked numbers are missing ones
        checked[key] = curve
        if curve.shape != (count,) or not np.isfinite(curve).all():
            raise ValueError(f"cycle {cycle}: {key} is not {count} finite numbers")
        check_size(f"cycle {cycle}", key, curve)
    check_rising(f"cycle {cycle}", checked["time_s"])
    return checked
