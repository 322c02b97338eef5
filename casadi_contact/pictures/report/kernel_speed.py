"""Table of a ``kernel_speed.json``: times and the ratios that matter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from casadi_contact.pictures.report.result_file import read_result
from casadi_contact.workflow.benchmark.kernel_speed import CALL_ALONE


def read_kernel_speed(path: str | Path) -> dict[str, Any]:
    """The content of a ``kernel_speed.json``; ValueError if it is something else."""
    return read_result(path, "kernel speed", "speed", kernel_speed_tables)


def times_the_limit(found: dict[str, Any], statistic: str = "median_us") -> str:
    """What a kernel takes, in multiples of the machine's limit, and without the call where that is timed."""
    limit, times = found["limit_us"], found["microseconds"]
    kernel = times["value, kernel"][statistic]
    text = f"{kernel / limit:.1f} times the limit"
    if CALL_ALONE in times:
        text += f", {(kernel - times[CALL_ALONE][statistic]) / limit:.1f} without the call"
    return text


def kernel_speed_tables(content: dict[str, Any]) -> list[Table]:
    """One table per surrogate: median, lowest and highest time per pose, and as a multiple of the kernel's."""
    tables = []
    for structure, found in content["surrogates"].items():
        caption = "one core, all loads, single buffered calls; EF in one batch"
        table = Table(title=f"Compiled kernel of {structure}", caption=f"{caption}\n{found['limit']}")
        table.add_column("what")
        for column in ("time per pose (µs)", "low-high", "times the kernel's"):
            table.add_column(column, justify="right")
        times = found["microseconds"]
        for what, timing in times.items():
            kind = what.partition(",")[0]
            kernel = times.get(f"{kind}, kernel", times["value, kernel"])["median_us"]
            span = f"{timing['low_us']:.2f}-{timing['high_us']:.2f}"
            table.add_row(what, f"{timing['median_us']:.2f}", span, f"{timing['median_us'] / kernel:.2f}")
        limit = found["limit_us"]
        share = f"{limit / times['value, kernel']['median_us']:.2f} (kernel: {times_the_limit(found)})"
        table.add_row("machine's limit", f"{limit:.2f}", "", share)
        tables.append(table)
    return tables
