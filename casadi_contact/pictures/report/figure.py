"""The frame of every chart: a panel or two, a title that says what was measured, a footnote with what failed."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from casadi_contact.core.quantities import FORCE, TORQUE, Kind, of_kind
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.benchmark.front_file import Front, Point

_ERRORS = ((FORCE, "force_rms_n"), (TORQUE, "torque_rms_nmm"))
_LEGEND_INCHES = 2.35
_CLOSE = (1.0, 2.0, 3.0, 5.0, 7.0)


def errors_of(front: Front) -> list[tuple[Kind, str]]:
    """The kinds of load that the front's scene has, force before torque, and what a `Point` calls their RMS error."""
    return [(kind, name) for kind, name in _ERRORS if of_kind(front.loads, kind)]


def panels(front: Front, count: int, title: str, measured: str | None = None, note: str = "") -> tuple[Any, Any]:
    """A figure and its axes side by side, one or two; measured says on what (poses of its motion that no model has seen
    if left out); note goes below, and failures of the file's models are listed there too."""
    width = 14.0 if count == 2 else 10.0
    figure = new_page(width, 6.8)
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
    said = textwrap.fill(f"{measured or unseen}; {machine}", int(13.0 * (width - 2.0 * _LEGEND_INCHES)))
    figure.suptitle(f"{header['scene']}: {title}\n{said}", fontsize=10, x=0.01, ha="left")
    failed = [f"{point.name}: {point.failure}" for point in front.points if point.failure]
    footnote = " ".join(filter(None, (note, f"Failed: {'; '.join(failed)}." if failed else "")))
    if footnote:
        figure.supxlabel("\n".join(textwrap.wrap(footnote, int(14.3 * width))), fontsize=8, x=0.01, ha="left")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for axis in axes:
        axis.grid(alpha=0.25, which="both", lw=0.5)
    return figure, axes


def log_scale(axes: Any, directions: str = "xy") -> None:
    """Logarithmic scales labelled in plain numbers: 1, 3, 10, 30, or 1, 2, 3, 5, 7, 10 where they span less than a
    factor of 30; linear where nothing above 0 is drawn."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    directions = "".join(d for d in directions if math.isfinite(getattr(axes, f"{d}axis").get_minpos()))
    axes.set(**{f"{direction}scale": "log" for direction in directions})
    for direction in directions:
        axis = getattr(axes, f"{direction}axis")
        low, high = axis.get_view_interval()
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high > 30.0 * low else _CLOSE, numticks=20))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def legend_beside(figure: Any, axes: Any) -> None:
    """One legend for all panels, right of them, with everything that any shows."""
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
        "foundation": "foundation, smooth quadrature",
        **{name: kind.title for name, kind in STRUCTURES.items()},
    }
    return known.get(family, family)


def families(points: Sequence[Point]) -> list[str]:
    """Families in the order of the file, once each."""
    return list(dict.fromkeys(point.family for point in points))
