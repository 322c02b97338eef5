"""Measure where methods fail: one table, method by failure, as text, CSV and JSON.

Run ``python -m problems.studies.stability --help``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from casadi_contact.files import writable_folder
from problems.common.command import RESULTS, new_app, run_command
from problems.studies.stability import (
    bad_training_data,
    clusters,
    consistency,
    derivative_steps,
    liftoff,
    out_of_range,
    single_precision,
    starts,
    time_steps,
)
from problems.studies.stability.methods import Bench, bench
from problems.studies.stability.picture import draw
from problems.studies.stability.table import FAILURES, Line, print_table, write_table

NAME = "stability"
app = new_app()


def _chosen(rows: str) -> list[int]:
    try:
        chosen = sorted({int(text) for text in rows.split(",")})
    except ValueError:
        chosen = []
    if not chosen or not set(chosen) <= set(FAILURES):
        raise ValueError(f"rows is {rows!r}, expected numbers from 1 to {max(FAILURES)} separated by commas")
    return chosen


def measure_row(row: int, known: Bench, *, count: int, quick: bool) -> tuple[list[Line], Any]:
    """Lines of one row, and what its picture needs."""
    rows: dict[int, Callable[[], tuple[list[Line], Any]]] = {
        1: lambda: starts.measure(known, count),
        2: lambda: liftoff.measure(known, 21 if quick else 61),
        3: lambda: out_of_range.measure(known, 2_000 if quick else 100_000),
        4: lambda: derivative_steps.measure(known, 4 if quick else 20),
        5: lambda: clusters.measure(known, (1e-5, 0.0) if quick else clusters.SPACINGS),
        6: lambda: time_steps.measure(known, (800.0,) if quick else time_steps.AXIAL_N),
        7: lambda: single_precision.measure(known, 4 if quick else 10),
        8: lambda: bad_training_data.measure(known, 500 if quick else 1500, 40 if quick else 150),
        9: lambda: consistency.measure(known),
    }
    return rows[row]()


@app.command()
def run(
    out: Annotated[Path, typer.Option(help="folder for stability.csv, .json and .png")] = RESULTS / NAME,
    rows: Annotated[str, typer.Option(help="rows to measure, separated by commas")] = ",".join(map(str, FAILURES)),
    count: Annotated[int, typer.Option(min=1, help="starts of row 1, for each distance")] = 200,
    quick: Annotated[bool, typer.Option("--quick", help="fewer starts and poses: a minute or two")] = False,
    patch: Annotated[str, typer.Option(help="a ready patch surrogate or the path of a .h5 file")] = "knee",
    two_stage: Annotated[str, typer.Option(help="the same in two stages")] = "knee_two_stage",
) -> None:
    """Measure every method on every failure."""
    chosen = _chosen(rows)
    writable_folder(out)
    count = min(count, 20) if quick else count
    known = bench(patch, two_stage, kriging_points=400 if quick else 2000, kernel_gflop=60.0 if quick else 300.0)
    lines: list[Line] = []
    curves: dict[str, Any] = {}
    for row in chosen:
        print(f"{row}. {FAILURES[row]}", file=sys.stderr)
        measured, curve = measure_row(row, known, count=count, quick=quick)
        lines += measured
        if curve is not None:
            curves[str(row)] = curve
        settings = {**known.settings, "count": count, "quick": quick}
        write_table(lines, out, settings, curves)  # after every row: an interruption keeps them
    draw(curves, out / "stability.png")
    print_table(lines)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
