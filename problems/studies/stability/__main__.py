"""Measure where methods fail: one table, method by failure, as text and JSON.

Run ``python -m problems.studies.stability --help``.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.core.terminal import PlainConsole, run_program
from problems.studies.stability import poses
from problems.studies.stability.methods import FAILURES, Bench, Line


def measure(row: int, bench: Bench, *, quick: bool) -> list[Line]:
    """Lines of one row; lift-off is measured on scenes with a lateral side alone."""
    if row == 1:
        return poses.starts(bench, 20 if quick else 200)
    if row == 2:
        return poses.liftoff(bench, 21 if quick else 61) if "Fy_lat" in bench.scene.load_names else []
    return poses.out_of_range(bench, 2_000 if quick else 100_000)


def run(
    scene: Annotated[str, typer.Argument(help="ready scene, or the path of a .toml")] = "knee",
    surrogate: Annotated[
        list[str] | None,
        typer.Option(help="name or .h5 file of a surrogate of the scene; the shipped ones if left out"),
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for stability.json")] = Path("results/stability"),
    rows: Annotated[str, typer.Option(help="rows to measure, separated by commas")] = "1,2,3",
    quick: Annotated[bool, typer.Option("--quick", help="fewer starts and poses: some minutes")] = False,
) -> None:
    """Measure every method on every failure."""
    chosen = [int(text) if text.strip().isdigit() else 0 for text in rows.split(",")]
    if not set(chosen) <= set(FAILURES):
        raise ValueError(f"rows is {rows!r}, expected some of {', '.join(map(str, FAILURES))} separated by commas")
    writable_folder(out)
    bench, lines = Bench.of(scene, surrogate or ()), list[Line]()
    settings = {"scene": bench.scene.name, "surrogates": ", ".join(bench.surrogates), "quick": "yes" if quick else "no"}
    for row in chosen:
        print(f"{row}. {FAILURES[row]}", file=sys.stderr)
        lines += measure(row, bench, quick=quick)
        content = {"settings": settings, "lines": [asdict(line) for line in lines], "machine": machine_record()}
        write_text(out / "stability.json", json.dumps(content, indent=1, ensure_ascii=False, default=str))
    table = Table("failure, case", "quantity", *bench.models, title="Stability where methods fail")
    for line in lines:
        cells = (f"{line.row}. {line.case}", line.quantity, *(line.cell(method) for method in bench.models))
        table.add_row(*map(escape, cells))
    PlainConsole().print(table)
    print(f"results in {out}")


if __name__ == "__main__":
    run_program(run)
