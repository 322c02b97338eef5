"""The chart of the measured speed-accuracy front: styles of families, panels, labels."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from casadi_contact.core.quantities import FORCE, TORQUE, Kind, of_kind
from casadi_contact.pictures.page import COLOURS, new_page, save_page
from casadi_contact.surrogate.load import STRUCTURES

if TYPE_CHECKING:
    from casadi_contact.workflow.benchmark.front_file import Front, Point, Timing

MARKERS = ("s", "o", "^", "D", "v", "P", "X", "*")
_FIRST = ("patch", "EF", "two_stage", "foundation")


def family_styles(families: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Keywords of matplotlib's ``plot`` for the markers of each family, no two alike; `_FIRST` always have the same."""
    colours = list(COLOURS.values())
    others = [family for family in dict.fromkeys(families) if family not in _FIRST]
    styles = {}
    for place, family in enumerate((*_FIRST, *others)):
        turn, index = divmod(place, len(colours))
        colour, marker = colours[(index + 2 * turn) % len(colours)], MARKERS[(index + 3 * turn) % len(MARKERS)]
        face = "white" if turn % 2 else colour
        styles[family] = {"color": colour, "marker": marker, "markerfacecolor": face, "markeredgewidth": 1.0}
    return {family: styles[family] for family in dict.fromkeys(families)}


_LEGEND_INCHES = 2.35
_CLOSE = (1.0, 2.0, 3.0, 5.0, 7.0)


def _panels(front: Front, count: int, title: str, measured: str | None) -> tuple[Any, Any]:
    """A figure and its axes side by side, one or two; failures of the file's models are listed below."""
    width = 14.0 if count == 2 else 10.0
    figure = new_page(width, 6.8)
    header = front.header
    seen = header.get("walking_poses", "?")
    unseen = f"{seen} unseen poses of its motion, errors against {header.get('reference', '?')}"
    processor = (header.get("processor", "unknown processor"), header.get("instruction_set"))
    machine = ", ".join(filter(None, (*processor, f"{header.get('threads', '?')} thread")))
    said = textwrap.fill(f"{measured or unseen}; {machine}", int(13.0 * (width - 2.0 * _LEGEND_INCHES)))
    figure.suptitle(f"{header['scene']}: {title}\n{said}", fontsize=10, x=0.01, ha="left")
    if failed := "; ".join(f"{point.name}: {point.failure}" for point in front.points if point.failure):
        footnote = textwrap.fill(f"Failed: {failed}.", int(14.3 * width))
        figure.supxlabel(footnote, fontsize=8, x=0.01, ha="left")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for axis in axes:
        axis.grid(alpha=0.25, which="both", lw=0.5)
    return figure, axes


def log_scale(axes: Any) -> None:
    """Logarithmic scales labelled in plain numbers: 1, 3, 10, 30, or 1, 2, 3, 5, 7, 10 where they span less than a
    factor of 30; linear where nothing above 0 is drawn."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if not math.isfinite(axis.get_minpos()):
            continue
        axes.set(**{f"{name}scale": "log"})
        low, high = axis.get_view_interval()
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high > 30.0 * low else _CLOSE, numticks=20))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def save(figure: Any, folder: Path, name: str) -> list[Path]:
    """Write a figure as .png and .svg."""
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    for path, metadata in zip(paths, (None, {"Date": None}), strict=True):
        save_page(figure, path, metadata=metadata)
    return paths


_NAMES = {"EF": "elastic foundation (EF), elements", "foundation": "foundation, smooth quadrature"}
_NAMES |= {"FE": "finite elements"} | {name: structure.title for name, structure in STRUCTURES.items()}
Measured: TypeAlias = "tuple[Point, Timing, float]"


def draw_speed_accuracy(front: Front, title: str = "time per pose against error", measured: str | None = None) -> Any:
    """Time per pose against RMS error, for forces and for torques, as far as the scene has them; measured: on what
    (unseen poses of the scene's motion if left out)."""
    kinds = [kind for kind in (FORCE, TORQUE) if of_kind(front.loads, kind)]
    figure, axes = _panels(front, len(kinds), title, measured)
    shown = []
    for axis, kind in zip(axes, kinds, strict=True):
        shown.append(_scatter(axis, front, kind))
        axis.set(xlabel="time per pose [µs]", ylabel=f"RMS {kind.name} error [{kind.unit}]")
    entries = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside right upper", fontsize=8, frameon=False)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    styles = family_styles([point.family for point in front.points])
    for axis, points in zip(axes, shown, strict=True):
        labels = []
        for family, style in styles.items():
            mine = [(timing.median_us, rms, point) for point, timing, rms in points if point.family == family]
            best = [mine[i] for i in pareto([row[:2] for row in mine])]  # of a peer the most accurate alone
            for x, y, point in best if family in _NAMES else best[-1:]:
                labels.append((x, y, point.name.removeprefix(f"{family} "), style["color"]))
        place_labels(axis, labels, [(timing.low_us, timing.high_us, rms) for _, timing, rms in points])
    return figure


def _scatter(axis: Any, front: Front, kind: Kind) -> list[Measured]:
    """Draw the points (model, timing, error) that have both numbers, with the spread of their times."""
    shown: list[Measured] = []
    for family, style in family_styles([point.family for point in front.points]).items():
        timed = [(p, p.value, p.rms(kind)) for p in front.models if p.family == family and p.value is not None]
        mine = [row for row in timed if row[2] > 0.0]
        if not mine:
            continue
        times, errors = [timing.median_us for _, timing, _ in mine], [rms for *_, rms in mine]
        spread = [[t.median_us - t.low_us for _, t, _ in mine], [t.high_us - t.median_us for _, t, _ in mine]]
        keywords = {"ls": "none", "ms": 6, "elinewidth": 0.8, "label": _NAMES.get(family, family), **style}
        axis.errorbar(times, errors, xerr=spread, **keywords)
        shown += mine
    best = [shown[i] for i in pareto([(timing.median_us, rms) for _, timing, rms in shown])]
    line = {"color": "0.6", "lw": 4.0, "alpha": 0.5, "zorder": 0, "label": "Pareto front"}
    axis.plot([timing.median_us for _, timing, _ in best], [rms for *_, rms in best], **line)
    log_scale(axis)
    axis.margins(0.08)
    return shown


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the (cost, error) pairs that no other equals or beats in both, cheapest first."""
    best, front = math.inf, []
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if points[index][1] < best:
            best = points[index][1]
            front.append(index)
    return front


_SIZE = 7.5  # of the text, in points
_DISTANCES = (7.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0, 90.0, 110.0)  # from the marker, in points
_ANGLES = np.deg2rad([0, 180, 90, 270, 45, 315, 135, 225, 20, 340, 160, 200])
_LEADER_FROM = 12.0
_MARKER = 4.0  # half the width of a marker, in points
_PASSES = 3


def place_labels(
    axis: Any, labels: Sequence[tuple[float, float, str, str]], bars: Sequence[tuple[float, float, float]]
) -> None:
    """Write (x, y, text, colour) on an axis whose layout is final, at the nearest free place, or where it covers least
    of the bars (from x, to x, y); a label far from its point gets a thin line to it."""
    from matplotlib.colors import to_rgb

    renderer, scale = axis.figure.canvas.get_renderer(), axis.figure.dpi / 72.0
    frame = axis.get_window_extent(renderer).extents
    points = axis.transData.transform([(x, y) for x, y, *_ in labels])
    low, high = (axis.transData.transform([(bar[k], bar[2]) for bar in bars]) for k in (0, 1))
    markers = np.hstack([low - _MARKER * scale, high + _MARKER * scale])
    directions = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)
    boxes, ways = np.zeros((len(labels), 4)), []
    for x, y, text, _ in labels:
        measured = axis.annotate(text, (x, y), fontsize=_SIZE)
        half = measured.get_window_extent(renderer).size / 2.0 + 1.0
        measured.remove()
        # The box's nearest edge, not its centre, keeps the distance.
        reach = np.minimum((half / np.maximum(np.abs(directions), 1e-9)).min(axis=1), half[0])
        away = ((np.array(_DISTANCES)[:, None] * scale + reach)[..., None] * directions).reshape(-1, 2)
        ways.append((away, half))
    best = np.zeros(len(labels), dtype=int)
    for _ in range(_PASSES):  # a label placed early may make way for those placed after it
        for i, (away, half) in enumerate(ways):
            tried = np.hstack([points[i] + away - half, points[i] + away + half])
            others = np.concatenate([markers, np.delete(boxes, i, axis=0)])
            covered = _covered(tried, others) + 4.0 * half.prod() - _covered(tried, frame[None])
            best[i] = covered.round(6).argmin()
            boxes[i] = tried[best[i]]
    look = {"textcoords": "offset points", "ha": "center", "va": "center", "fontsize": _SIZE}
    for (x, y, text, bright), (away, _), k in zip(labels, ways, best, strict=True):
        colour = [0.6 * part for part in to_rgb(bright)]  # dark enough to be read as text
        line = {"arrowstyle": "-", "lw": 0.4, "color": colour, "shrinkA": 0.0, "shrinkB": 2.0}
        leader = line if _DISTANCES[k // len(directions)] > _LEADER_FROM else None
        axis.annotate(text, (x, y), away[k] / scale, color=colour, arrowprops=leader, **look)


def _covered(boxes: Any, taken: Any) -> Any:
    """Area (n,) of boxes (n, 4), each (left, bottom, right, top), that lies on boxes (k, 4) already taken."""
    sides = np.minimum(boxes[:, None, 2:], taken[:, 2:]) - np.maximum(boxes[:, None, :2], taken[:, :2])
    return np.maximum(sides, 0.0).prod(axis=2).sum(axis=1)
