"""The fixed body's contact surface as flat elements: centres, outward unit normals, areas.

Elements come in square blocks of neighbours, for the elastic foundation's culling.
"""

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array

BLOCK_SIDE = 4  # elements per block edge: measured faster than 8 on grids from 40×30 to 320×160

CellGrid = tuple[Array, Array, Array]  # centres, unit normals (nx, nz, 3) and areas (nx, nz) of a patch's cells


@dataclass(frozen=True)
class ElementGrid:
    """Elements of one patch in block order, fixed frame.

    centres_mm, normals (m, 3); areas_mm2 (m,); edge_centres_mm (k, 3) of the outermost elements;
    blocks (b + 1,) first element of each block, which has BLOCK_SIDE² elements at most.
    """

    centres_mm: Array
    normals: Array
    areas_mm2: Array
    edge_centres_mm: Array
    blocks: np.ndarray


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors (..., 3) normal to unit normals (..., 3) and to each other, right-handed with these."""
    first = np.cross(np.eye(3)[np.abs(normals).argmin(axis=-1)], normals)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(normals, first)


def cell_middles(count: int) -> Array:
    """Middles (count,) of equal cells of [-1, 1]."""
    return (2.0 * np.arange(count) + 1.0) / count - 1.0


def grid_elements(centres: Array, normals: Array, areas: Array, outermost: np.ndarray | None = None) -> ElementGrid:
    """Elements of a patch's cells (nx, nz), those of no area left out.

    Outermost are those at the edge of the patch or beside a cell of no area, or of these the ones named (nx, nz).
    """
    nx, nz = areas.shape
    present = areas > 0.0
    inner = np.zeros((nx, nz), dtype=bool)
    inner[1:-1, 1:-1] = present[2:, 1:-1] & present[:-2, 1:-1] & present[1:-1, 2:] & present[1:-1, :-2]
    index = np.arange(nx * nz).reshape(nx, nz)
    blocks = []
    for i in range(0, nx, BLOCK_SIDE):
        for k in range(0, nz, BLOCK_SIDE):
            cells = (slice(i, i + BLOCK_SIDE), slice(k, k + BLOCK_SIDE))
            blocks.append(index[cells][present[cells]])
    edge = centres[present & ~inner & (True if outermost is None else outermost)]
    return _in_blocks(centres.reshape(-1, 3), normals.reshape(-1, 3), areas.ravel(), edge, blocks)


def scattered_elements(centres: Array, normals: Array, areas: Array, outermost: np.ndarray) -> ElementGrid:
    """Elements in no grid, (m, 3), (m, 3) and (m,); outermost (m,) is True for those at an edge."""
    return _in_blocks(centres, normals, areas, centres[outermost], _halves(centres, np.arange(len(centres))))


def _halves(centres: Array, members: np.ndarray) -> list[np.ndarray]:
    """Groups of at most BLOCK_SIDE² neighbouring elements, by halving along the longest extent."""
    if len(members) <= BLOCK_SIDE**2:
        return [members]
    axis = int(np.argmax(np.ptp(centres[members], axis=0)))
    ordered = members[np.argsort(centres[members, axis])]
    return [group for half in np.array_split(ordered, 2) for group in _halves(centres, half)]


def _in_blocks(centres: Array, normals: Array, areas: Array, edge: Array, blocks: list[np.ndarray]) -> ElementGrid:
    blocks = [block for block in blocks if block.size]
    starts = np.cumsum([0, *(block.size for block in blocks)], dtype=np.int64)
    flat = np.concatenate([np.zeros(0, dtype=np.int64), *blocks])
    return ElementGrid(centres[flat], normals[flat], areas[flat], edge, starts)


# Fixed surfaces y(x, z) over a rectangle of nx × nz equal cells: each element lies at its cell's centre on the surface,
# with area dA = dx·dz/n_y (midpoint rule, so that loads converge as h²).


def plane(grid: tuple[int, int], extent: tuple[float, float]) -> CellGrid:
    """The rectangle y = 0 of this extent (along x, along z) [mm] about the origin."""
    x, z, cell = _rectangle(grid, extent)
    normals = np.zeros((*grid, 3))
    normals[..., 1] = 1.0
    return _cells(x, np.zeros_like(x), z, normals, cell)


def dish(grid: tuple[int, int], extent: tuple[float, float], sagittal_radius: float, frontal_radius: float) -> CellGrid:
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


def _rectangle(grid: tuple[int, int], extent: tuple[float, float]) -> tuple[Array, Array, float]:
    """x and z of the cells' centres (nx, nz) and the area of a cell."""
    (nx, nz), (length, width) = grid, extent
    x = ((np.arange(nx) + 0.5) / nx - 0.5) * length
    z = ((np.arange(nz) + 0.5) / nz - 0.5) * width
    return *np.meshgrid(x, z, indexing="ij"), (length / nx) * (width / nz)


def _cells(x: Array, y: Array, z: Array, normals: Array, cell: float) -> CellGrid:
    return np.stack([x, y, z], axis=-1), normals, cell / normals[..., 1]
