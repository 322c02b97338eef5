"""What the pictures share: pages, discs in true size, axes with units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.pictures.view import View

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
