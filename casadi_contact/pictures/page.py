"""A page of pictures: made without a display, written whole, in colours that the colour-blind tell apart."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import replacing
from casadi_contact.pictures.view import View

# Okabe and Ito, Color universal design (2008); the order keeps the first ones apart in lightness as well.
COLOURS = {
    "blue": "#0072B2",
    "black": "#000000",
    "orange": "#E69F00",
    "vermillion": "#D55E00",
    "purple": "#CC79A7",
    "green": "#009E73",
    "sky blue": "#56B4E9",
    "yellow": "#F0E442",
}
# What a curve stands for has one look on every page: keywords of matplotlib's ``plot``.
TARGET = {"color": COLOURS["black"], "lw": 4.0, "alpha": 0.25}
SURROGATE = {"color": COLOURS["blue"], "lw": 1.6}
FOUNDATION = {"color": COLOURS["vermillion"], "lw": 1.2, "ls": "--"}
FAILED = {"color": COLOURS["purple"], "ls": "", "marker": "x"}
_DOTS_PER_INCH = 130


def new_page(width: float, height: float, **padding: Any) -> Any:
    """An empty page [inch]; padding: of matplotlib's constrained layout, such as w_pad. matplotlib is loaded here."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    # The resolution of the file: a text's width depends on it, by the hinting of its letters.
    page = Figure(figsize=(width, height), dpi=_DOTS_PER_INCH, layout=ConstrainedLayoutEngine(**padding))
    FigureCanvasAgg(page)  # knows how large a text comes out
    return page


def frame(axes: Iterable[Any], xlabel: str) -> None:
    """The same abscissa and a faint grid for all axes."""
    for axis in axes:
        axis.set_xlabel(xlabel)
        axis.grid(alpha=0.3)


def save_page(page: Any, path: str | Path, *, dots_per_inch: float = _DOTS_PER_INCH, **more: Any) -> None:
    """Write a page in the format of the path's ending (PNG if it has none); more: of matplotlib's ``savefig``."""
    path = Path(path)
    with replacing(path) as beside:
        page.savefig(beside, format=path.suffix[1:] or "png", dpi=dots_per_inch, **more)


# An open ring, through which the contact shows.
CENTRE_OF_PRESSURE: dict[str, Any] = {
    "marker": "o",
    "markersize": 6,
    "markerfacecolor": "none",
    "markeredgewidth": 1.0,
    "color": "red",
    "linestyle": "none",
}
_PATCH_TITLES = {"med": "medial", "lat": "lateral"}


def patch_title(patch: str) -> str:
    """A patch's name spelled out where it is a common one."""
    return _PATCH_TITLES.get(patch, patch)


def new_figure(width: float, height: float) -> Any:
    """An empty page [inch] whose panels keep the scale of their axes."""
    return new_page(width, height, w_pad=0.08, h_pad=0.08, wspace=0.04, hspace=0.04, compress=True)


def save(figure: Any, path: str | Path) -> None:
    """Write the page, cut to what is drawn, in the format of the path's ending (PNG if it has none)."""
    save_page(figure, path, bbox_inches="tight")


def discs(axis: Any, points_mm: Array, diameters_mm: Array | float, view: View, **colours: Any) -> Any:
    """Points (n, 3) as the view sees them, each a disc of its diameter on the scale of the axes."""
    from matplotlib.collections import EllipseCollection

    offsets = np.stack([view.right.of(points_mm), view.up.of(points_mm)], axis=1)
    sizes = np.broadcast_to(diameters_mm, len(offsets))
    drawn = EllipseCollection(
        sizes, sizes, np.zeros(len(sizes)), units="xy", offsets=offsets, transOffset=axis.transData, **colours
    )
    axis.add_collection(drawn)
    axis.update_datalim(offsets)
    return drawn


def name_axes(axis: Any, view: View) -> None:
    """Equal scales, labels with units, and the directions in which the coordinates grow."""
    axis.set(aspect="equal", xlabel=view.right.label, ylabel=view.up.label)
    axis.autoscale_view()
    axis.xaxis.set_inverted(view.right.reversed)
    axis.yaxis.set_inverted(view.up.reversed)
