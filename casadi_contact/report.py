"""Tables for the terminal and a speed-accuracy chart, drawn from result files only."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.table import Table

from casadi_contact.conventions import load_unit
from casadi_contact.files import replacing


def read_evaluation(path: str | Path) -> dict[str, Any]:
    """The content of an ``evaluation.json``; ValueError if it is something else."""
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not an evaluation file ({error})") from None
    if not isinstance(content, dict) or content.get("format") != "casadi_contact evaluation":
        raise ValueError(f"{path} is not an evaluation file, expected one written by casadi-contact evaluate")
    return content


def evaluation_tables(content: dict[str, Any]) -> list[Table]:
    """The paper's Tables 2, 3 and 4 from an ``evaluation.json``."""
    loads = content["loads"]
    teacher = f"EF {content['teacher']}" if content["teacher"] else "the samples"
    tables = []
    for key, title in (("rms", "RMS error per domain (Table 2)"), ("max", "Largest error per domain (Table 3)")):
        table = Table(title=f"{title}, unseen samples against {teacher}")
        for column in ("model", "domain", "samples"):
            table.add_column(column)
        for load in loads:
            table.add_column(f"{load} ({load_unit(load)})", justify="right")
        for model, domains in content["domain_errors"].items():
            for domain, errors in domains.items():
                cells = [f"{errors[load][key]:.3g}" if load in errors else "-" for load in loads]
                table.add_row(model, domain, str(content["test_samples"][domain]), *cells)
            table.add_section()
        tables.append(table)
    if "walking" not in content:
        return tables
    walking = content["walking"]
    table = Table(title=f"Speed and accuracy on {walking['poses']} unseen walking poses inside D1 (Table 4)")
    table.add_column("model")
    for column in (
        "time (µs)",
        "low-high",
        "RMS force (N)",
        "RMS torque (N·mm)",
        f"against EF {walking['fine']}: force",
        "torque",
    ):
        table.add_column(column, justify="right")
    for model, row in walking["models"].items():
        timing = row["timing"]
        span = f"{timing['low_us']:.1f}-{timing['high_us']:.1f}"
        time = f"{timing['median_us']:.1f}"
        cells = [f"{row[against][kind]:.3g}" for against in ("converged", "fine") for kind in ("force", "torque")]
        table.add_row(model, time, span, *cells)
    tables.append(table)
    return tables


def draw_speed_accuracy(content: dict[str, Any], path: Path) -> None:
    """Time per pose against RMS error on the unseen walking sequence, for force and for torque, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    walking = content["walking"]
    families = (("EF ", "elastic foundation", "o", "#D55E00"), ("", "surrogate, CasADi MX", "s", "#0072B2"))
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axis, (kind, unit) in zip(figure.subplots(1, 2), (("force", "N"), ("torque", "N·mm")), strict=True):
        left = dict(walking["models"])
        for start, label, marker, color in families:
            mine = {name: left.pop(name) for name in list(left) if name.startswith(start)}
            times = [row["timing"]["median_us"] for row in mine.values()]
            errors = [row["converged"][kind] for row in mine.values()]
            low = [row["timing"]["median_us"] - row["timing"]["low_us"] for row in mine.values()]
            high = [row["timing"]["high_us"] - row["timing"]["median_us"] for row in mine.values()]
            joined = {"ls": "-" if start else "none", "lw": 0.8}
            axis.errorbar(times, errors, xerr=[low, high], marker=marker, color=color, label=label, **joined)
            for name, time, error in zip(mine, times, errors, strict=True):
                place = {"textcoords": "offset points", "xytext": (6, 5 if start else -11), "fontsize": 8}
                axis.annotate(name.removeprefix("EF "), (time, error), **place)
        axis.set(xscale="log", yscale="log", xlabel="time per pose, one core [µs]", ylabel=f"RMS {kind} error [{unit}]")
        axis.grid(alpha=0.3, which="both")
    figure.axes[0].legend(fontsize=8)
    title = f"{content['scene']}: {walking['poses']} unseen walking poses, errors against EF {walking['converged']}"
    figure.suptitle(f"{title}; {content['machine']['processor']}", fontsize=10)
    with replacing(path) as beside:
        figure.savefig(beside, dpi=110, format="png")
