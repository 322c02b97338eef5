"""Tables for the terminal, from result files: evaluation, kernel speed, and the choice of a model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.table import Table

from casadi_contact.core.files.reading import MOST_TEXT, checked_size
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, quantity, three_digits
from casadi_contact.workflow.benchmark.choose import Choice
from casadi_contact.workflow.benchmark.front_file import Front

_COMMANDS = {"kernel speed": "speed", "evaluation": "evaluate"}


def read_result(path: str | Path, kind: str) -> dict[str, Any]:
    """The content of a ``kernel_speed.json`` ("kernel speed") or an ``evaluation.json`` ("evaluation"), whose
    ``format`` is "casadi_contact KIND"; ValueError if it is something else."""
    checked_size(Path(path), MOST_TEXT)
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a file of {kind} ({error})") from None
    if not isinstance(content, dict) or content.get("format") != f"casadi_contact {kind}":
        raise ValueError(f"{path} is not a file of {kind}, expected one written by casadi-contact {_COMMANDS[kind]}")
    return content


def kernel_speed_tables(content: dict[str, Any]) -> list[Table]:
    """One table per surrogate: median, lowest and highest time per pose, and as a multiple of the kernel's."""
    tables = []
    for structure, found in content["surrogates"].items():
        caption = "one core, all loads, single buffered calls; EF in one batch"
        table = Table(title=f"Compiled kernel of {structure}", caption=caption)
        table.add_column("what")
        for column in ("time per pose (µs)", "low-high", "times the kernel's"):
            table.add_column(column, justify="right")
        times = found["microseconds"]
        for what, timing in times.items():
            kind = what.partition(",")[0]
            kernel = times.get(f"{kind}, kernel", times["value, kernel"])["median_us"]
            span = f"{timing['low_us']:.2f}-{timing['high_us']:.2f}"
            table.add_row(what, f"{timing['median_us']:.2f}", span, f"{timing['median_us'] / kernel:.2f}")
        tables.append(table)
    return tables


def choice_table(choice: Choice) -> Table:
    """The chosen model and the next better one: time per pose, RMS errors on unseen poses of the scene's motion."""
    table = Table(
        title=f"Cheapest model for {', '.join(choice.loads)} within tolerance, errors on unseen poses of its motion"
    )
    errors = [("force_rms_n", FORCE), ("torque_rms_nmm", TORQUE)]
    shown = [(error, kind) for error, kind in errors if of_kind(choice.loads, kind)]
    for column in ("", "model", "time [µs]", *(f"RMS {kind.name} [{kind.unit}]" for _, kind in shown)):
        table.add_column(column, justify="right" if "[" in column else "left")
    for what, offer in (("chosen", choice.model), ("next better", choice.better)):
        if offer is None:
            table.add_row(what, "none measured is more accurate")
            continue
        cells = (f"{getattr(offer, error):.3g}" for error, _ in shown)
        table.add_row(what, offer.name, f"{offer.time_us:.3g}", *cells)
    return table


def evaluation_tables(content: dict[str, Any]) -> list[Table]:
    """The paper's Tables 2 and 3 from an ``evaluation.json``."""
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
    return tables


def front_table(front: Front) -> Table:
    """Speed and accuracy of a measured front [EF15 Table 4]."""
    header = front.header
    table = Table(
        title=f"Speed and accuracy on {header['walking_poses']} unseen poses of its motion inside D1 [EF15 Table 4], "
        f"against {header['reference']}"
    )
    kinds = [kind for kind in (FORCE, TORQUE) if of_kind(front.loads, kind)]
    table.add_column("model")
    for column in ("time [µs]", "low-high", *(f"RMS {kind.name} [{kind.unit}]" for kind in kinds)):
        table.add_column(column, justify="right")
    for point in front.models:
        if (time := point.value) is not None:
            errors = (f"{point.rms(kind):.3g}" for kind in kinds)
            table.add_row(point.name, f"{time.median_us:.3g}", f"{time.low_us:.3g}-{time.high_us:.3g}", *errors)
    return table
