"""One table, method by failure: lines, and how they are printed and written."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from casadi_contact.scenes.columns import write_columns
from problems.common.records import write_summary
from problems.studies.stability.methods import METHODS

FAILURES = {
    1: "starts out of contact and too deep",
    2: "lift-off and landing of one side",
    3: "poses to three times the learned range",
    4: "gradients by differences",
    5: "dense clusters of samples",
    6: "largest stable time step",
    7: "float32 against float64",
    8: "bad training data",
    9: "mechanical consistency",
}


@dataclass(frozen=True)
class Line:
    """One measured quantity of one failure, for every method: a number or short text, or no entry with a reason."""

    row: int
    case: str
    quantity: str
    values: Mapping[str, float | str]
    reasons: Mapping[str, str] = field(default_factory=dict)

    def cell(self, method: str) -> str:
        """What the table shows: "-" where the quantity makes no sense for a method."""
        value = self.values.get(method)
        if value is None:
            return "-"
        if isinstance(value, str):
            return value
        if not np.isfinite(value):
            return "inf" if np.isinf(value) else "NaN"
        return f"{value:.0f}" if 100.0 <= abs(value) < 1e5 else f"{value:.3g}"


def methods_of(lines: Sequence[Line]) -> list[str]:
    """The methods that lines tell of, in the order of the table."""
    told = {method for line in lines for method in (*line.values, *line.reasons)}
    return [method for method in METHODS if method in told]


def print_table(lines: Sequence[Line]) -> None:
    """The lines as one table, and below it why a cell is empty."""
    console = Console(width=None if sys.stdout.isatty() else 200)  # a file has room
    table = Table(title="Stability where methods fail")
    table.add_column("failure, case")
    table.add_column("quantity")
    methods = methods_of(lines)
    for method in methods:
        table.add_column(method, justify="right")
    for row in sorted({line.row for line in lines}):
        table.add_section()
        table.add_row(f"[bold]{row}. {FAILURES[row]}")
        for line in (line for line in lines if line.row == row):
            table.add_row(*map(escape, (line.case, line.quantity, *(line.cell(method) for method in methods))))
    console.print(table)
    seen = dict.fromkeys((line.row, m, why) for line in lines for m, why in line.reasons.items())
    for row, method, why in seen:
        console.print(f"{row}. {method}: {why}", highlight=False, markup=False)


def write_table(
    lines: Sequence[Line], out: Path, settings: Mapping[str, Any], curves: Mapping[str, Any] | None = None
) -> None:
    """stability.csv (a line of the table each, with the reasons for its empty cells) and stability.json (with curves by
    row, for the picture)."""
    columns: dict[str, Any] = {
        "row": [line.row for line in lines],
        "failure": [FAILURES[line.row] for line in lines],
        "case": [line.case for line in lines],
        "quantity": [line.quantity for line in lines],
    }
    columns |= {method: [line.values.get(method, "-") for line in lines] for method in methods_of(lines)}
    columns["remarks"] = ["; ".join(f"{method}: {why}" for method, why in line.reasons.items()) for line in lines]
    write_columns(out / "stability.csv", columns)
    content = {
        "settings": dict(settings),
        "lines": [asdict(line) for line in lines],
        "curves": dict(curves or {}),
    }
    write_summary(out / "stability.json", content)
