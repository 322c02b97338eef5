"""Fixed surfaces y(x, z) over a rectangle of nx × nz equal cells in the x-z plane.

Each cell's element lies at its centre on the surface, with area dA = dx·dz/n_y: the midpoint rule, so that loads
converge as h².
"""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import Cells


def plane(grid: tuple[int, int], extent: tuple[float, float]) -> Cells:
    """The rectangle y = 0 of this extent (along x, along z) [mm] about the origin."""
    x, z, cell = _rectangle(grid, extent)
    normals = np.zeros((*grid, 3))
    normals[..., 1] = 1.0
    return _cells(x, np.zeros_like(x), z, normals, cell)


def dish(grid: tuple[int, int], extent: tuple[float, float], sagittal_radius: float, frontal_radius: float) -> Cells:
    """Concave torus piece, lowest at y = 0: a frontal arc r swept about the axis y = R parallel to z."""
    x, z, cell = _rectangle(grid, extent)
    offset = sagittal_radius - frontal_radius
    tube = np.sqrt(frontal_radius**2 - z**2)
    rho = offset + tube
    y = sagittal_radius - np.sqrt(rho**2 - x**2)
    # Towards the centre of the frontal arc, which lies at distance `offset` from the axis.
    inward = np.stack([-x, sagittal_radius - y], axis=-1) / rho[..., None]
    normals = np.stack([inward[..., 0] * tube, inward[..., 1] * tube, -z], axis=-1) / frontal_radius
    return _cells(x, y, z, normals, cell)


def shift(cells: Cells, z_mm: float) -> Cells:
    """The same surface, moved along z."""
    centres, normals, areas = cells
    return centres + np.array([0.0, 0.0, z_mm]), normals, areas


def _rectangle(grid: tuple[int, int], extent: tuple[float, float]) -> tuple[Array, Array, float]:
    """x and z of the cells' centres (nx, nz) and the area of a cell."""
    (nx, nz), (length, width) = grid, extent
    x = ((np.arange(nx) + 0.5) / nx - 0.5) * length
    z = ((np.arange(nz) + 0.5) / nz - 0.5) * width
    return *np.meshgrid(x, z, indexing="ij"), (length / nx) * (width / nz)


def _cells(x: Array, y: Array, z: Array, normals: Array, cell: float) -> Cells:
    return np.stack([x, y, z], axis=-1), normals, cell / normals[..., 1]
