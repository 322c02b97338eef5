"""Lines between cells: closer together over ridges of the fixed surface, on which spots of contact are narrow.

A body of curvature κ0 that presses a ridge of curvature κ by a depth d touches √(2d/(κ + κ0)) to each side of it. Cells
there are smaller than on the flat in about that proportion. Their sizes change gradually, because cubics over unequal
cells are less accurate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from casadi_contact.contact.cells.basis import middles
from casadi_contact.core.conventions import Array

_BLUNT = 0.08  # curvature [1/mm] up to which cells are as large as on the flat
_DENSEST = 3.3  # times as many cells as on the flat, on the sharpest ridge
_GRADUAL = 2.5  # cells: standard deviation of the Gaussian that densities are smoothed with


@dataclass(frozen=True)
class Lines:
    """The n + 1 lines across one side of a chart: places (n + 1,) [mm], the size of cells there (n + 1,) [mm], which is
    the places' derivative by their number, and the sub-points in between (n·parts,) [mm]."""

    places: Array
    sizes: Array
    sub_points: Array


def density(convex: Array) -> Array:
    """How many times as many cells there are as on the flat, by the surface's curvature [1/mm], convex above zero."""
    return np.clip(np.sqrt(np.maximum(convex, 0.0) / _BLUNT), 1.0, _DENSEST)


def lay_lines(low: float, high: float, size_mm: float, densities: Array, parts: int, cut: int = 1) -> Lines:
    """Lines from `low` to `high` [mm], about `size_mm` apart where the density is 1, two cells at least, of which each
    is then cut into so many; densities (m,): at equal steps of that way."""
    x = np.linspace(low, high, len(densities))
    smooth = gaussian_filter1d(densities, _GRADUAL * size_mm / (x[1] - x[0]), mode="nearest")
    number = cumulative_trapezoid(smooth / size_mm, x, initial=0.0)
    count = max(round(number[-1]), 2)
    place = CubicSpline(number * count / number[-1], x)
    lines = np.arange(cut * count + 1.0) / cut
    return Lines(place(lines), place(lines, 1) / cut, place(lines[:-1, None] + middles(parts) / cut).ravel())
