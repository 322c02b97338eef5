"""Columns of numbers by name from a CSV file, checked."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.files import MOST_TEXT, checked_size, short


def read_columns(
    path: str | Path, *, required: Sequence[str], optional: Sequence[str] = (), what: str = "file"
) -> dict[str, Array]:
    """The required columns and those of the optional ones that the file has, each (n,); others are ignored.

    what names the file in messages.
    Raises FileNotFoundError for no file, and ValueError naming file, line and column for missing or repeated columns,
    text among the numbers, ragged rows, NaN and a file without rows.
    """
    path = Path(path)
    if not path.is_file():
        why = "is a folder, expected a CSV file" if path.is_dir() else "does not exist"
        raise FileNotFoundError(f"{what} {path} {why}")
    checked_size(path, MOST_TEXT)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [(number, row) for number, row in enumerate(csv.reader(file), start=1) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path} is not a CSV text file ({error})") from None
    if not rows:
        raise ValueError(f"{path} is empty, expected a header and rows of numbers")
    header = [name.strip() for name in rows[0][1]]
    missing = [column for column in required if column not in header]
    if missing:
        raise ValueError(f"{path} lacks the columns {', '.join(missing)}; it has {short(', '.join(header))}")
    wanted = [column for column in (*required, *optional) if column in header]
    repeated = [column for column in wanted if header.count(column) > 1]
    if repeated:
        raise ValueError(f"{path} has the column {repeated[0]} more than once")
    places = {column: header.index(column) for column in wanted}
    numbers = np.empty((len(rows) - 1, len(wanted)))
    for k, (line, row) in enumerate(rows[1:]):
        if len(row) != len(header):
            raise ValueError(f"{path} line {line}: got {len(row)} values, expected {len(header)}")
        for c, (column, place) in enumerate(places.items()):
            try:
                numbers[k, c] = float(row[place])
            except ValueError:
                raise ValueError(
                    f"{path} line {line}, {column}: got {short(row[place])!r}, expected a number"
                ) from None
            if not math.isfinite(numbers[k, c]):
                raise ValueError(f"{path} line {line}, {column}: got {row[place].strip()}, expected a finite number")
    if not len(numbers):
        raise ValueError(f"{path} has a header only, expected rows of numbers below it")
    return {column: numbers[:, c].copy() for c, column in enumerate(wanted)}
