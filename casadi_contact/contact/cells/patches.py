"""Patches cut into cubic cells: what the quadrature reads, in NumPy and in C.

Cells are smaller over ridges of the fixed surface, where contact areas are narrow: a body of curvature κ0 that presses
a ridge of curvature κ by a depth d touches √(2d/(κ + κ0)) to each side of it (`charts.density`). Sizes change
gradually, because cubics over unequal cells are less accurate.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from casadi_contact.contact.cells.basis import Cells, middles
from casadi_contact.contact.cells.charts import Chart, MeshChart, PlaneChart, SoleChart
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class Lines:
    """The n + 1 lines across one side of a chart: places (n + 1,) [mm], the size of cells there (n + 1,) [mm], which is
    the places' derivative by their number, and the sub-points in between (n·parts,) [mm]."""

    places: Array
    sizes: Array
    sub_points: Array


def lay_lines(
    low: float, high: float, size_mm: float, densities: Array, parts: int, cut: int = 1, gradual: float = 2.5
) -> Lines:
    """Lines from `low` to `high` [mm], about `size_mm` apart where the density is 1: two cells at least, each then cut
    into so many. densities (m,) lie at equal steps between the ends; a Gaussian of `gradual` cells (σ) smooths them."""
    x = np.linspace(low, high, len(densities))
    smooth = gaussian_filter1d(densities, gradual * size_mm / (x[1] - x[0]), mode="nearest")
    number = cumulative_trapezoid(smooth / size_mm, x, initial=0.0)
    count = max(round(number[-1]), 2)
    place = CubicSpline(number * count / number[-1], x)
    lines = np.arange(cut * count + 1.0) / cut
    return Lines(place(lines), place(lines, 1) / cut, place(lines[:-1, None] + middles(parts) / cut).ravel())


CELL_SHAPES = ("mesh", "mesh_on_ground", "foot_on_ground", "sphere_on_plane", "cylinder_on_plane", "punch_on_plane")

BOXES = 8  # that the kernel tests together


@dataclass(frozen=True)
class CellPatch:
    """One patch of m nodes and k cells, fixed frame.

    c, n (m, 3): points and unit normals; tangents, bends (m, 2, 3): their derivatives times the size of cells there;
    loads (m, 7): N·a, c×N·a and |N|·a with N = τ_v × τ_u and a their area, so that |N|·a is an area [mm²]; known
    (m,): False for nodes beyond the rim. corners (k, 4): nodes at 00, 01, 10, 11; present (k, sub-points): the
    share of the surface at them, 0 beyond its rim; rim (k,): cells at the rim. blocks (b + 1,): first cell of each.
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
    if scene.shape in ("mesh", "mesh_on_ground"):
        return [MeshChart(scene, patch) for patch in scene.patch_names]
    g = scene.geometry
    if scene.shape == "foot_on_ground":
        return [SoleChart(g)]
    if scene.shape == "punch_on_plane":
        return [PlaneChart(g["area"] ** 0.5, g["area"] ** 0.5)]
    if scene.shape in CELL_SHAPES:
        return [PlaneChart(g["patch_side"], g.get("length", g["patch_side"]))]
    known = f"expected one of {', '.join(CELL_SHAPES)}; others take cc.ElasticFoundation"
    raise ValueError(f"scene {scene.name} has the shape {scene.shape}, which cubic cells do not cover: {known}")


def lay_cells(chart: Chart, cells: Cells, cut: int = 3) -> CellPatch:
    """The cells of the chart's faces that hold some surface, those at their rims cut into cut×cut, block by block."""
    patches = [_lay(face, cells, cut) for face in chart.faces]
    parts = {field.name: [getattr(patch, field.name) for patch in patches] for field in fields(CellPatch)}
    # Corners are numbers of nodes, blocks those of cells: both count on from the faces before.
    nodes, rows = (np.cumsum([0, *map(len, parts[name][:-1])]) for name in ("c", "corners"))
    parts["corners"] = [corners + first for corners, first in zip(parts["corners"], nodes, strict=True)]
    ends = [blocks[1:] + first for blocks, first in zip(parts["blocks"], rows, strict=True)]
    parts["blocks"] = [np.zeros(1, dtype=int), *ends]
    return CellPatch(**{name: np.concatenate(of_faces) for name, of_faces in parts.items()})


def _lay(chart: Chart, cells: Cells, cut: int) -> CellPatch:
    """The cells of one face."""
    lattices = [_Lattice.laid(chart, cells, parts) for parts in (1, cut)]
    rim, ends = lattices[0].rim, _Lattice.laid(chart.whole, cells, cut).rim
    chosen = [lattices[0].held & ~rim, lattices[1].held & np.kron(rim, np.ones((cut, cut), dtype=bool))]
    lattice = np.repeat([0, 1], [of.sum() for of in chosen])
    index = np.concatenate([np.argwhere(of) for of in chosen])
    sides = np.array([_block(np.array([cells.u_mm, cells.v_mm]) / parts) for parts in (1, cut)])
    order, blocks = _in_blocks(np.column_stack([lattice, index // sides[lattice]]))
    lattice, index = lattice[order], index[order]
    numbers = np.stack([np.column_stack([lattice, index + np.array(end)]) for end in product((0, 1), repeat=2)], 1)
    nodes, corners = np.unique(numbers.reshape(-1, 3), axis=0, return_inverse=True)
    laid = np.empty((2, len(nodes), 2))
    present = np.empty((len(index), cells.sub_points))
    for number, of in enumerate(lattices):
        at, here = nodes[:, 0] == number, lattice == number
        laid[:, at] = of.at(nodes[at, 1:])
        present[here] = of.present[tuple(index[here].T)]
    places, sizes = laid
    surface = chart.surface(*places.T)
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
        present,
        (lattice == 1) & ends[tuple((index * lattice[:, None]).T)],
        blocks,
    )


@dataclass(frozen=True)
class _Lattice:
    """Cells over a whole chart: lines across u (nu + 1) and v (nv + 1); present (nu, nv, sub-points): a share."""

    u: Lines
    v: Lines
    present: Array

    @classmethod
    def laid(cls, chart: Chart, cells: Cells, cut: int, probes: int = 4) -> _Lattice:
        """Each of the cells cut into cut×cut. probes: points along each side of a sub-point, to find its share."""
        u, v = (
            lay_lines(chart.low[axis], chart.high[axis], size_mm, chart.densities[axis], probes * parts, cut)
            for axis, (size_mm, parts) in enumerate(((cells.u_mm, cells.along_u), (cells.v_mm, cells.along_v)))
        )
        nu, nv = len(u.places) - 1, len(v.places) - 1
        on_surface = chart.present(u.sub_points, v.sub_points)
        shares = on_surface.reshape(nu, cells.along_u, probes, nv, cells.along_v, probes).mean(axis=(2, 5))
        return cls(u, v, np.moveaxis(shares, 1, 2).reshape(nu, nv, -1))

    @property
    def held(self) -> np.ndarray:
        """Cells (nu, nv) that hold some surface."""
        return np.asarray(self.present.any(axis=-1))

    @property
    def rim(self) -> np.ndarray:
        """Cells (nu, nv) that the surface does not fill, and their neighbours."""
        whole = np.pad((self.present == 1.0).all(axis=-1), 1)
        return ~(whole[1:-1, 1:-1] & whole[2:, 1:-1] & whole[:-2, 1:-1] & whole[1:-1, 2:] & whole[1:-1, :-2])

    def at(self, nodes: np.ndarray) -> Array:
        """(u, v) of nodes (m, 2), by the numbers of their lines, and the sizes of cells there: (2, m, 2) [mm]."""
        pairs = ((self.u.places, self.v.places), (self.u.sizes, self.v.sizes))
        return np.stack([np.stack([u[nodes[:, 0]], v[nodes[:, 1]]], 1) for u, v in pairs])


def _single(x: Array) -> Array:
    """Rounded to what the kernel stores in single precision."""
    return x.astype(np.float32).astype(float)


def _block(step: Array, most_mm: float = 4.0) -> tuple[int, int]:
    """Cells along the sides of a block with a diagonal of most_mm at most: those that fill its boxes, `BOXES` together,
    best; of these the most. Cells so large that half of the boxes were empty: `BOXES` as close together as can be."""
    sides = [(a, b) for a in range(1, 9) for b in range(1, 9)]
    across = {side: float(np.hypot(*(step * side))) for side in sides}
    within = [side for side in sides if np.prod(side) == 1 or across[side] <= most_mm]
    best = max(within, key=lambda side: (np.prod(side) / -(-np.prod(side) // BOXES), np.prod(side)))
    if 2 * np.prod(best) >= BOXES:
        return best
    return min((side for side in sides if np.prod(side) == BOXES), key=lambda side: across[side])


def _in_blocks(block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The order (k,) of cells block by block, block (k, 3) being that of each, and the first cell of each (b + 1,)."""
    order = np.lexsort(block.T[::-1])
    firsts = np.flatnonzero(np.diff(block[order], axis=0).any(axis=1)) + 1
    return order, np.concatenate([[0], firsts, [len(order)]])
