"""The frame of every chart: two panels, a title that says what was measured, a footnote with what failed."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from casadi_contact.benchmark.front_file import Front, Point
from casadi_contact.page import new_page, save_page
from casadi_contact.structures import STRUCTURES

KINDS = (("force", "force_rms_n", "N"), ("torque", "torque_rms_nmm", "N·mm"))


def two_panels(front: Front, title: str, measured: str | None = None, note: str = "") -> tuple[Any, Any]:
    """A figure and its two axes; measured says on what (poses of its motion that no model has seen if left out); note
    goes below, and failures of the file's models are listed there too."""
    figure = new_page(14.0, 6.8)
    header = front.header
    seen = header.get("walking_poses", "?")
    unseen = f"{seen} unseen poses of its motion, errors against {header.get('reference', '?')}"
    machine = ", ".join(
        (
            header.get("processor", "unknown processor"),
            *filter(None, (header.get("instruction_set"),)),
            f"{header.get('threads', '?')} thread",
        )
    )
    figure.suptitle(f"{header['scene']}: {title}\n{measured or unseen}; {machine}", fontsize=10)
    failed = [f"{point.name}: {point.failure}" for point in front.points if point.failure]
    footnote = " ".join(filter(None, (note, f"Failed: {'; '.join(failed)}." if failed else "")))
    if footnote:
        figure.supxlabel("\n".join(textwrap.wrap(footnote, 200)), fontsize=8, x=0.01, ha="left")
    axes = figure.subplots(1, 2)
    for axis in axes:
        axis.grid(alpha=0.25, which="both", lw=0.5)
    return figure, axes


def log_scale(axes: Any, directions: str = "xy") -> None:
    """Logarithmic scales labelled 1, 3, 10, 30 in plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axes.set(**{f"{direction}scale": "log" for direction in directions})
    for direction in directions:
        axis = getattr(axes, f"{direction}axis")
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0), numticks=20))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def legend_beside(figure: Any, axes: Any) -> None:
    """One legend for both panels, right of them, with everything that either shows."""
    entries = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside right upper", fontsize=8, frameon=False)


def save(figure: Any, folder: Path, name: str) -> list[Path]:
    """Write a figure as .png and .svg."""
    paths = []
    for ending in ("png", "svg"):
        path = folder / f"{name}.{ending}"
        save_page(figure, path, metadata={"Date": None} if ending == "svg" else None)
        paths.append(path)
    return paths


def family_name(family: str) -> str:
    """A family as the legend calls it."""
    known = {
        "EF": "elastic foundation (EF), elements",
        "foundation": "EF, rays or cells",
        **{name: kind.title for name, kind in STRUCTURES.items()},
    }
    return known.get(family, family)


def families(points: Sequence[Point]) -> list[str]:
    """Families in the order of the file, once each."""
    return list(dict.fromkeys(point.family for point in points))
