"""A page of pictures: made without a display, written whole, in colours that the colour-blind tell apart."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from casadi_contact.files import replacing

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
WANTED = {"color": COLOURS["black"], "lw": 4.0, "alpha": 0.25}
SURROGATE = {"color": COLOURS["blue"], "lw": 1.6}
FOUNDATION = {"color": COLOURS["vermillion"], "lw": 1.2, "ls": "--"}
FAILED = {"color": COLOURS["purple"], "ls": "", "marker": "x"}
_DOTS_PER_INCH = 130


def new_page(width: float, height: float, **padding: Any) -> Any:
    """An empty page [inch]; padding: of matplotlib's constrained layout, such as w_pad. matplotlib is loaded here."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    page = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(**padding))
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
