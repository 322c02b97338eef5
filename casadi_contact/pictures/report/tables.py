"""Tables for the terminal, from ``evaluation.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from casadi_contact.contact.elements.foundation import grid_text
from casadi_contact.core.quantities import beside, quantity, three_digits
from casadi_contact.pictures.report.result_file import read_result
from casadi_contact.scenes.scene import Scene


def read_evaluation(path: str | Path) -> dict[str, Any]:
    """The content of an ``evaluation.json``; ValueError if it is something else."""
    return read_result(path, "evaluation", "evaluate", evaluation_tables)


def fine_grid_remark(content: dict[str, Any], scene: Scene) -> str:
    """What to know of the scene's fine grid, where an ``evaluation.json`` has it off by more than a tolerance in D1
    (RMS against what the samples were drawn from); "" otherwise. The grid was chosen for another motion, or by hand."""
    if "fine" not in scene.grids:  # a scene with a contact model of the user's own needs none
        return ""
    grid = grid_text(scene.grids["fine"])
    errors = content["domain_errors"].get(f"EF {grid}", {}).get("D1", {})
    above = {name: error["rms"] for name, error in errors.items() if error["rms"] > scene.tolerances[name]}
    if not above:
        return ""
    load = max(above, key=lambda name: above[name] / scene.tolerances[name])
    tolerance = scene.tolerances[load]
    off = f"{beside(above[load], tolerance)} {quantity(load).unit}"
    return (
        f"the scene's fine grid, {grid}, is off by {off} in {load} in D1, "
        f"tolerance {tolerance:g}: for checks of your own take a finer one (grids.fine), or cc.foundation"
    )


def evaluation_tables(content: dict[str, Any]) -> list[Table]:
    """The paper's Tables 2, 3 and 4 from an ``evaluation.json``."""
    loads = content["loads"]
    others = {None: "the samples", "foundation": "cc.foundation"}
    teacher = others.get(content["teacher"], f"EF {content['teacher']}")
    tables = []
    for key, title in (
        ("rms", "RMS error per domain [EF15 Table 2]"),
        ("max", "Largest error per domain [EF15 Table 3]"),
    ):
        table = Table(title=f"{title}, unseen samples against {teacher}")
        for column in ("model", "domain", "samples"):
            table.add_column(column)
        for load in loads:
            table.add_column(f"{load} ({quantity(load).unit})", justify="right")
        for model, domains in content["domain_errors"].items():
            for domain, errors in domains.items():
                cells = [three_digits(errors[load][key]) if load in errors else "-" for load in loads]
                table.add_row(model, domain, str(content["test_samples"][domain]), *cells)
            table.add_section()
        tables.append(table)
    if "walking" not in content:
        return tables
    walking = content["walking"]
    table = Table(
        title=f"Speed and accuracy on {walking['poses']} unseen poses of its motion inside D1 [EF15 Table 4], against "
        f"EF {walking['converged']}"
    )
    table.add_column("model")
    units = {quantity(load).kind.name: quantity(load).unit for load in loads}
    kinds = [kind for kind in next(iter(walking["models"].values()))["converged"] if kind in units]
    against_fine = [f"against EF {walking['fine']}: {kinds[0]}", *kinds[1:]]
    for column in ("time (µs)", "low-high", *(f"RMS {kind} ({units[kind]})" for kind in kinds), *against_fine):
        table.add_column(column, justify="right")
    for model, row in walking["models"].items():
        timing = row["timing"]
        span = f"{timing['low_us']:.1f}-{timing['high_us']:.1f}"
        time = f"{timing['median_us']:.1f}"
        cells = [f"{row[against][kind]:.3g}" for against in ("converged", "fine") for kind in kinds]
        table.add_row(model, time, span, *cells)
    tables.append(table)
    return tables
