"""Patches cut into cubic cells: what the quadrature reads, in NumPy and in C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.charts import Chart, CupChart, PlaneChart
from casadi_contact.contact.cells.grading import lay_lines
from casadi_contact.contact.cells.mesh_chart import MeshChart
from casadi_contact.conventions import Array
from casadi_contact.scenes import Scene

CELL_SHAPES = ("mesh", "ball_in_cup", "sphere_on_plane", "cylinder_on_plane", "punch_on_plane")

BLOCK_MM = 4.0  # diagonal of a block of cells, at most, unless cells are large
LOOKS = 4  # along each side of a sub-point, to find its share of the surface
BOXES = 8  # that the kernel looks at together


@dataclass(frozen=True)
class CellPatch:
    """One patch of m nodes and k cells, fixed frame.

    c, n (m, 3): points and unit normals; tangents, bends (m, 2, 3): their derivatives times the size of cells there;
    loads (m, 7): N·a, c×N·a and |N|·a with N = τ_v × τ_u and a their area, so that |N|·a is an area [mm²]; known
    (m,): False for nodes beyond the rim. corners (k, 4): nodes at 00, 01, 10, 11; present (k, sub-points): the
    share of the surface at them, 0 beyond its rim; rim (k,): cells at the rim. blocks (b + 1,): first cell of each block.
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


def patch_charts(scene: Scene) -> list[Chart]:
    """The charts of a scene's patches; raises ValueError for a shape that has none."""
    if scene.shape == "mesh":
        return [MeshChart(scene, patch) for patch in scene.patch_names]
    if scene.shape == "ball_in_cup":
        return [CupChart(scene)]
    g = scene.geometry
    if scene.shape == "punch_on_plane":
        return [PlaneChart(g["area"] ** 0.5, g["area"] ** 0.5)]
    if scene.shape in CELL_SHAPES:
        return [PlaneChart(g["patch_side"], g.get("length", g["patch_side"]))]
    raise ValueError(
        f"scene {scene.name} has the shape {scene.shape}, which cubic cells do not cover: expected one of "
        f"{', '.join(CELL_SHAPES)}; others take cc.ElasticFoundation"
    )


def lay_cells(chart: Chart, cells: Cells) -> CellPatch:
    """The chart's cells that hold some surface, block by block, and their corners."""
    across_u, across_v = (
        lay_lines(chart.low[axis], chart.high[axis], size_mm, chart.densities[axis], LOOKS * parts)
        for axis, (size_mm, parts) in enumerate(((cells.u_mm, cells.along_u), (cells.v_mm, cells.along_v)))
    )
    nu, nv = len(across_u.places) - 1, len(across_v.places) - 1
    present = chart.present(across_u.sub_points, across_v.sub_points)
    looks = present.reshape(nu, cells.along_u, LOOKS, nv, cells.along_v, LOOKS)
    shares = np.moveaxis(looks.mean(axis=(2, 5)), 1, 2).reshape(nu, nv, -1)
    whole = np.pad((shares == 1.0).all(axis=-1), 1)
    rim = ~(whole[1:-1, 1:-1] & whole[2:, 1:-1] & whole[:-2, 1:-1] & whole[1:-1, 2:] & whole[1:-1, :-2])
    held = np.asarray(shares.any(axis=-1))
    order, blocks = _in_blocks(held, _block(np.array([cells.u_mm, cells.v_mm])))
    i, j = order.T
    numbers = np.stack([(i + a) * (nv + 1) + j + b for a in (0, 1) for b in (0, 1)], 1)
    used, corners = np.unique(numbers, return_inverse=True)
    row, column = np.divmod(used, nv + 1)
    surface = chart.surface(across_u.places[row], across_v.places[column])
    sizes = np.stack([across_u.sizes[row], across_v.sizes[column]], 1)
    N = np.cross(surface.tangents[:, 1], surface.tangents[:, 0]) * sizes.prod(axis=1)[:, None]
    N *= np.sign(np.einsum("ij,ij->i", N, surface.n))[:, None]
    loads = np.concatenate([N, np.cross(surface.c, N), np.linalg.norm(N, axis=1, keepdims=True)], 1)
    return CellPatch(
        surface.c,
        _single(surface.n),
        _single(surface.tangents * sizes[..., None]),
        _single(surface.bends * sizes[..., None]),
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
