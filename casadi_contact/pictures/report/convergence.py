"""How the error of each network fell while it was fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from casadi_contact.pictures.page import COLOURS, frame, new_page

_DASHES = ("-", "--", ":", "-.")


def draw_convergence(courses: Mapping[str, Mapping[str, Sequence[float]]]) -> Any:
    """RMS of the fit against the work done, of networks by name: {"gflop": ..., "rms": ...} as a surrogate's record
    has them, the first entries of zero work left out. Torques and forces share an axis: compare a curve with itself.
    """
    figure = new_page(7.2, 3.6)
    axis = figure.subplots()
    colours = list(COLOURS.values())
    for number, (name, course) in enumerate(courses.items()):
        colour, dash = colours[number % len(colours)], _DASHES[number // len(colours) % len(_DASHES)]
        axis.plot(course["gflop"], course["rms"], dash, color=colour, lw=1.3, label=name)
    axis.set(xscale="log", yscale="log", ylabel="RMS of the fit [N, N·mm]")
    axis.legend(fontsize=7, ncols=2)
    frame([axis], "work done [Gflop]")
    return figure
