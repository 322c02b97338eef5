"""A page of pictures, made without a display, and the direction from which a scene is looked at."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import ANATOMY, Array
from casadi_contact.core.files.writing import replacing
from casadi_contact.scenes.shapes.shape import shape_named

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
        axis.set(xlabel=xlabel)
        axis.grid(alpha=0.3)


def save_page(page: Any, path: str | Path, *, dots_per_inch: float = _DOTS_PER_INCH, **more: Any) -> None:
    """Write a page in the format of the path's ending (PNG if it has none); more: of matplotlib's ``savefig``."""
    path = Path(path)
    with replacing(path) as beside:
        page.savefig(beside, format=path.suffix[1:] or "png", dpi=dots_per_inch, **more)


# An open ring, through which the contact shows.
CENTRE_OF_PRESSURE: dict[str, Any] = {"marker": "o", "ms": 6, "mfc": "none", "mew": 1.0, "color": "red", "ls": "none"}
_PATCH_TITLES = {"med": "medial", "lat": "lateral"}


def patch_title(patch: str) -> str:
    """A patch's name spelled out where it is a common one."""
    return _PATCH_TITLES.get(patch, patch)


def new_figure(width: float, height: float) -> Any:
    """An empty page [inch] whose panels keep the scale of their axes."""
    return new_page(width, height, w_pad=0.08, h_pad=0.08, wspace=0.04, hspace=0.04, compress=True)


def discs(axis: Any, points_mm: Array, diameters_mm: Array | float, view: View, **colours: Any) -> Any:
    """Points (n, 3) as the view sees them, each a disc of its diameter on the scale of the axes."""
    from matplotlib.collections import EllipseCollection

    offsets = np.stack([view.right.of(points_mm), view.up.of(points_mm)], axis=1)
    sizes = np.broadcast_to(diameters_mm, len(offsets))
    place = {"units": "xy", "offsets": offsets, "transOffset": axis.transData}
    drawn = EllipseCollection(sizes, sizes, np.zeros(len(sizes)), **place, **colours)
    axis.add_collection(drawn)
    axis.update_datalim(offsets)
    return drawn


def name_axes(axis: Any, view: View) -> None:
    """Equal scales, labels with units, and the directions in which the coordinates grow."""
    axis.set(aspect="equal", xlabel=view.right.label, ylabel=view.up.label)
    axis.autoscale_view()
    axis.xaxis.set_inverted(view.right.reversed)
    axis.yaxis.set_inverted(view.up.reversed)


_LEAST_MEAN_NORMAL = 0.05  # below, the elements face all ways
_LETTERS = ("x", "y", "z")
_LEAST_SHARE = 0.3  # of a unit vector, to be named among its anatomical directions


@dataclass(frozen=True, eq=False)
class PictureAxis:
    """A coordinate c = direction·p of points p, rightwards or upwards in a picture; reversed: leftwards or downwards.
    direction (3,) is a unit vector whose largest component is positive. anatomical: directions have names."""

    direction: Array
    reversed: bool = False
    anatomical: bool = True

    @classmethod
    def along(cls, vector: Array, *, anatomical: bool = True) -> PictureAxis:
        """The axis whose coordinate grows, or falls, rightwards or upwards, for that to be the direction `vector`."""
        unit = vector / np.linalg.norm(vector)
        backwards = bool(unit[np.abs(unit).argmax()] < 0.0)
        return cls(np.where(backwards, -unit, unit) + 0.0, backwards, anatomical)

    @property
    def name(self) -> str:
        """x, y or z, or, of an oblique axis, where it grows towards in a joint (medial-inferior), else its formula."""
        formula = direction_formula(self.direction)
        return formula if formula in _LETTERS or not self.anatomical else anatomical_name(self.direction)

    @property
    def label(self) -> str:
        """The coordinate and where it grows towards: "z, medial [mm]", or below each other for an oblique one."""
        formula, towards = direction_formula(self.direction), anatomical_name(self.direction)
        if not self.anatomical:
            return f"{formula} [mm]"
        return f"{formula}, {towards} [mm]" if formula in _LETTERS else f"{towards} [mm]\n{formula}"

    @property
    def pointing(self) -> Array:
        """Unit vector (3,) of rightwards or upwards in the picture."""
        return -self.direction if self.reversed else self.direction

    def of(self, points_mm: Array) -> Array:
        """Coordinates (...) [mm] of points (..., 3)."""
        return points_mm @ self.direction


@dataclass(frozen=True, eq=False)
class View:
    """Right, up and towards the viewer: a right-handed frame, so that nothing is seen mirrored."""

    right: PictureAxis
    up: PictureAxis
    toward: PictureAxis

    @classmethod
    def along(cls, direction: Array, *, anatomical: bool = True) -> View:
        """Seen along a direction (3,); upwards is y, or x where that direction is nearer to y than to the x-z plane."""
        toward = -direction / np.linalg.norm(direction)
        rough = np.eye(3)[0 if abs(toward[1]) > np.sqrt(0.5) else 1]
        up = rough - (rough @ toward) * toward
        seen = (np.cross(up, toward), up, toward)
        return cls(*(PictureAxis.along(vector, anatomical=anatomical) for vector in seen))

    @property
    def behind(self) -> View:
        """Seen the other way, as the fixed surface sees the moving body."""
        return View.along(self.toward.pointing, anatomical=self.toward.anatomical)

    @property
    def name(self) -> str:
        """The direction that is looked along: inferior (−y) for a knee, posterior (+x) for a patella."""
        along = -self.toward.pointing
        formula = direction_formula(along)
        signed = f"+{formula}" if formula in _LETTERS else formula
        return f"{anatomical_name(along)} ({signed})" if self.toward.anatomical else signed


def view_of(model: ElasticFoundation) -> View:
    """The view along the direction of pressing of the first patch, or, where its normal load has none, against the mean
    normal of all elements (into a hip's cup; along -y if they face all ways)."""
    direction = model.scene.normal_loads[0].direction
    if direction is None:
        grids = model.scene.elements(model.grid)
        areas = np.concatenate([grid.areas_mm2 for grid in grids])
        mean = areas @ np.concatenate([grid.normals for grid in grids]) / areas.sum()
        direction = -mean if np.linalg.norm(mean) > _LEAST_MEAN_NORMAL else np.array([0.0, -1.0, 0.0])
    return View.along(direction, anatomical=shape_named(model.scene.shape).anatomical)


def direction_formula(direction: Array) -> str:
    """A unit vector in letters: -y, or 0.98 x - 0.18 y; components below 0.005 are left out."""
    parts = ""
    for letter, value in zip(_LETTERS, direction, strict=True):
        if abs(value) >= 0.005:
            size = "" if abs(value) > 0.9999 else f"{abs(value):.2f} "
            sign = "−" if value < 0.0 else "+" if parts else ""
            parts += f" {sign} {size}{letter}" if parts else f"{sign}{size}{letter}"
    return parts


def anatomical_name(direction: Array) -> str:
    """A unit vector in a joint's frame in words, its largest component first: medial-inferior."""
    order = [k for k in np.argsort(-np.abs(direction), kind="stable") if abs(direction[k]) > _LEAST_SHARE]
    return "-".join(ANATOMY[_LETTERS[k]][0 if direction[k] > 0.0 else 1] for k in order)
