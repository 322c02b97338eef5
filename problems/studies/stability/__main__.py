"""Measure where methods fail: one table, method by failure, as text, CSV and JSON.

Run ``python -m problems.studies.stability --help``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from casadi_contact.cli.arguments import Scheduler
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.workers import cluster_workers
from problems.common.command import RESULTS, new_app, run_command
from problems.studies.stability.picture import draw
from problems.studies.stability.rows import Plan, kept, measure_rows
from problems.studies.stability.table import Line, print_table, write_table

NAME = "stability"
app = new_app()


def _chosen(rows: str | None, possible: Sequence[int]) -> list[int]:
    if rows is None:
        return list(possible)
    try:
        chosen = sorted({int(text) for text in rows.split(",")})
    except ValueError:
        chosen = []
    if not chosen or not set(chosen) <= set(possible):
        raise ValueError(f"rows is {rows!r}, expected some of {', '.join(map(str, possible))} separated by commas")
    return chosen


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="knee, or another scene that networks were built for")] = "knee",
    out: Annotated[Path, typer.Option(help="folder for stability.csv, .json and .png")] = RESULTS / NAME,
    rows: Annotated[str | None, typer.Option(help="rows to measure, separated by commas; all if left out")] = None,
    count: Annotated[int, typer.Option(min=1, help="starts of row 1, for each distance")] = 200,
    quick: Annotated[bool, typer.Option("--quick", help="fewer starts and poses: some minutes")] = False,
    patch: Annotated[str, typer.Option(help="a ready patch surrogate or the path of a .h5 file")] = "knee",
    two_stage: Annotated[str, typer.Option(help="the same in two stages")] = "knee_two_stage",
    preset: Annotated[str, typer.Option(help="preset that another scene was built by")] = "quick",
    folder: Annotated[Path | None, typer.Option(help="folder of that build; results/SCENE-PRESET if left out")] = None,
    scheduler: Scheduler = None,
) -> None:
    """Measure every method on every failure."""
    plan = kept(Plan(min(count, 20) if quick else count, quick, patch, two_stage, scene, preset, folder))
    chosen = _chosen(rows, plan.rows)
    writable_folder(out)
    measured: dict[int, list[Line]] = {}
    curves: dict[str, Any] = {}
    with cluster_workers(scheduler) as executor:
        for row, lines, curve in measure_rows(chosen, plan, executor):
            measured[row] = lines
            if curve is not None:
                curves[str(row)] = curve
            write_table(_in_order(measured), out, plan.settings, curves)  # after every row: an interruption keeps them
    draw(curves, out / "stability.png")
    print_table(_in_order(measured))
    typer.echo(f"results in {out}")


def _in_order(measured: Mapping[int, list[Line]]) -> list[Line]:
    return [line for row in sorted(measured) for line in measured[row]]


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
