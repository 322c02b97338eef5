"""Labels beside points, none over another label, a marker or the frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

_SIZE = 7.5  # of the text, in points
_DISTANCES = (7.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0, 90.0, 110.0)  # from the marker, in points
_ANGLES = np.deg2rad([0, 180, 90, 270, 45, 315, 135, 225, 20, 340, 160, 200])
_LEADER_FROM = 12.0
_MARKER = 4.0  # half the width of a marker, in points
_PASSES = 3


def place_labels(
    axis: Any,
    labels: Sequence[tuple[float, float, str, str]],
    bars: Sequence[tuple[float, float, float]] = (),
) -> None:
    """Write (x, y, text, colour) on an axis whose limits and layout are final, at the nearest free place.

    bars: horizontal error bars (x from, x to, y) that no label should lie on.

    A label far from its point gets a thin line to it. Where no place is free, the label goes where it covers least.
    """
    figure = axis.figure
    renderer = figure.canvas.get_renderer()
    frame = axis.get_window_extent(renderer)
    scale = figure.dpi / 72.0
    points = axis.transData.transform([(x, y) for x, y, _, _ in labels])
    half = _MARKER * scale
    taken = [(x - half, y - half, x + half, y + half) for x, y in points]
    for low, high, y in bars:
        (left, level), (right, _) = axis.transData.transform([(low, y), (high, y)])
        taken.append((left, level - 1.0, right, level + 1.0))
    halves = []
    for x, y, text, colour in labels:
        drawn = axis.annotate(text, (x, y), fontsize=_SIZE, color=colour)
        extent = drawn.get_window_extent(renderer)
        halves.append(np.array([extent.width, extent.height]) / 2.0 + 1.0)
        drawn.remove()
    places: dict[int, _Place] = {}
    for _ in range(_PASSES):  # a label placed early may make way for those placed after it
        for i, pixel in enumerate(points):
            others = [*taken, *(place.box for j, place in places.items() if j != i)]
            places[i] = _free_place(pixel, halves[i], others, frame, scale)
    for i, (x, y, text, colour) in enumerate(labels):
        line = {"arrowstyle": "-", "lw": 0.4, "color": colour, "shrinkA": 0.0, "shrinkB": 2.0}
        axis.annotate(
            text,
            (x, y),
            xytext=(places[i].centre - points[i]) / scale,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=_SIZE,
            color=colour,
            arrowprops=line if places[i].distance > _LEADER_FROM else None,
        )


class _Place(NamedTuple):
    """Where a label goes: its distance from the marker [points], its centre and its box [pixels]."""

    distance: float
    centre: Any
    box: tuple[float, ...]


def _free_place(pixel: Any, half: Any, taken: Sequence[Sequence[float]], frame: Any, scale: float) -> _Place:
    """The nearest place around a marker that covers nothing, or the one that covers least."""
    best, least = None, np.inf
    for distance in _DISTANCES:
        for angle in _ANGLES:
            direction = np.array([np.cos(angle), np.sin(angle)])
            # The box's nearest edge, not its centre, keeps the distance.
            reach = np.min(half / np.maximum(np.abs(direction), 1e-9))
            centre = pixel + direction * (distance * scale + min(reach, half[0]))
            box = (*(centre - half), *(centre + half))
            covered = sum(_overlap(box, other) for other in taken) + _outside(box, frame)
            if covered < least:
                best, least = _Place(distance, centre, box), covered
        if least == 0.0:
            break
    assert best is not None
    return best


def _overlap(a: Sequence[float], b: Sequence[float]) -> float:
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    return float(width * height) if width > 0.0 and height > 0.0 else 0.0


def _outside(box: Sequence[float], frame: Any) -> float:
    area = (box[2] - box[0]) * (box[3] - box[1])
    return float(area - _overlap(box, (frame.x0, frame.y0, frame.x1, frame.y1)))
