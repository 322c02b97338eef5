"""Patches cut into cubic cells: what the quadrature reads, in NumPy and in C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.cells.basis import Cells, middles
from casadi_contact.contact.cells.charts import Chart
from casadi_contact.conventions import Array

BLOCK_MM = 4.0  # diagonal of a block of cells, at most, unless cells are large
BOXES = 8  # that the kernel looks at together


@dataclass(frozen=True)
class CellPatch:
    """One patch of m nodes and k cells, fixed frame.

    c, n (m, 3): points and unit normals; tangents, bends (m, 2, 3): their derivatives times the size of a cell; loads
    (m, 7): N·a, c×N·a and |N|·a with N = τ_v × τ_u and a the size of a cell, so that |N|·a is an area [mm²]; known
    (m,): False for nodes beyond the rim. corners (k, 4): nodes at 00, 01, 10, 11; present (k, sub-points): 1 where the
    surface is, 0 beyond its rim; rim (k,): cells at the rim. blocks (b + 1,): first cell of each block.
    """

    c: Array
    n: Array
    tangents: Array
    bends: Array
    loads: Array
    known: np.ndarray
    corners: np.ndarray
    present: Array
    rim: np.ndarray
    blocks: np.ndarray


def cell_counts(chart: Chart, cells: Cells) -> tuple[int, int]:
    """The numbers of cells along u and v whose size comes nearest."""
    counts = np.maximum(np.round((chart.high - chart.low) / [cells.u_mm, cells.v_mm]), 2).astype(int)
    return int(counts[0]), int(counts[1])


def lay_cells(chart: Chart, cells: Cells) -> CellPatch:
    """The chart's cells that hold some surface, block by block, and their corners."""
    nu, nv = cell_counts(chart, cells)
    step = (chart.high - chart.low) / [nu, nv]
    u, v = (
        chart.low[axis] + step[axis] * (np.arange(count)[:, None] + middles(parts)).ravel()
        for axis, (count, parts) in enumerate(((nu, cells.along_u), (nv, cells.along_v)))
    )
    present = chart.present(u, v).reshape(nu, cells.along_u, nv, cells.along_v)
    shares = np.moveaxis(present, 1, 2).reshape(nu, nv, -1).astype(float)
    whole = np.pad((shares == 1.0).all(axis=-1), 1)
    rim = ~(whole[1:-1, 1:-1] & whole[2:, 1:-1] & whole[:-2, 1:-1] & whole[1:-1, 2:] & whole[1:-1, :-2])
    held = np.asarray(shares.any(axis=-1))
    order, blocks = _in_blocks(held, _block(step))
    i, j = order.T
    numbers = np.stack([(i + a) * (nv + 1) + j + b for a in (0, 1) for b in (0, 1)], 1)
    used, corners = np.unique(numbers, return_inverse=True)
    surface = chart.surface(chart.low[0] + step[0] * (used // (nv + 1)), chart.low[1] + step[1] * (used % (nv + 1)))
    scaled = step[:, None]
    N = np.cross(surface.tangents[:, 1], surface.tangents[:, 0]) * step.prod()
    N *= np.sign(np.einsum("ij,ij->i", N, surface.n))[:, None]
    loads = np.concatenate([N, np.cross(surface.c, N), np.linalg.norm(N, axis=1, keepdims=True)], 1)
    return CellPatch(
        surface.c,
        _single(surface.n),
        _single(surface.tangents * scaled),
        _single(surface.bends * scaled),
        _single(loads),
        surface.known,
        corners.reshape(-1, 4),
        shares[i, j],
        rim[i, j],
        blocks,
    )


def _single(x: Array) -> Array:
    """Rounded to what the kernel stores in single precision."""
    return x.astype(np.float32).astype(float)


def _block(step: Array) -> tuple[int, int]:
    """Cells along the sides of a block: those that fill its boxes, `BOXES` together, best; of these the most. Where
    more than half of the boxes would stay empty, as of large cells, `BOXES` cells as close together as can be."""
    sides = [(a, b) for a in range(1, 9) for b in range(1, 9)]
    across = {side: float(np.hypot(*(step * side))) for side in sides}
    within = [side for side in sides if np.prod(side) == 1 or across[side] <= BLOCK_MM]
    best = max(within, key=lambda side: (np.prod(side) / -(-np.prod(side) // BOXES), np.prod(side)))
    if 2 * np.prod(best) >= BOXES:
        return best
    return min((side for side in sides if np.prod(side) == BOXES), key=lambda side: across[side])


def _in_blocks(held: np.ndarray, side: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Indices (k, 2) of the cells held, block by block of `side` cells, and the first cell of each block (b + 1,)."""
    order, sizes = [], []
    for i in range(0, held.shape[0], side[0]):
        for j in range(0, held.shape[1], side[1]):
            cells = np.argwhere(held[i : i + side[0], j : j + side[1]]) + np.array([i, j])
            if len(cells):
                order.append(cells)
                sizes.append(len(cells))
    return np.concatenate(order), np.concatenate([[0], np.cumsum(sizes)])
