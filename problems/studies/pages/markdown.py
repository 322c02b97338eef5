"""Markdown of a page of results: its head, what it was measured on, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_PACKAGES = ("casadi_contact", "casadi", "numpy", "scipy", "numba", "torch")


def page(title: str, *parts: str) -> str:
    """A page that says below its title that it is not to be edited: sites take a page's name from its first line."""
    return "\n\n".join((f"# {title}", "<!-- written by python -m problems.studies.pages -->", *parts)) + "\n"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, texts: Sequence[str] = ()) -> str:
    """A table; all columns but the first, and those named texts, hold numbers and are aligned right."""
    marks = ("---" if column in (columns[0], *texts) else "---:" for column in columns)
    head = [" | ".join(columns), " | ".join(marks)]
    return "\n".join(f"| {line} |" for line in (*head, *(" | ".join(row) for row in rows)))


def machine(record: Mapping[str, Any]) -> str:
    """What was measured on, as a sentence: processor, instruction set, system, versions."""
    instructions = record.get("instruction_set", "instruction set not recorded")
    flags = f", kernels compiled with `{record['kernel_flags']}`" if "kernel_flags" in record else ""
    versions = ", ".join(f"{name} {record[name]}" for name in _PACKAGES if name in record)
    return (
        f"Measured on: {record['processor']} ({instructions}{flags}), {record['cores']} cores, {record['system']}; "
        f"Python {record['python']}, {versions}."
    )


def number(value: float) -> str:
    """Three digits, without an exponent where that is short."""
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"
