"""The fixed body's contact surface as a grid of flat elements: centres, outward unit normals, areas.

A patch spans a rectangle of nx × nz equal cells in the x-z plane; each element lies at its cell's centre on the
surface y(x, z) with area dA = dx·dz/n_y, the midpoint rule, so loads converge as h². Over a mesh see
`geometry.mesh_elements`. Elements are ordered in square blocks with a bounding box each,
for the elastic foundation's culling.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.geometry.joint_elements import joint_elements
from casadi_contact.geometry.mesh_bodies import body_field, patch_box, patch_mesh
from casadi_contact.geometry.mesh_elements import grid_on_mesh, open_triangles, triangles_on_mesh
from casadi_contact.scenes import Scene
from casadi_contact.scenes.joint_shapes import JOINT_PARAMETERS

BLOCK_SIDE = 4  # elements per block edge: measured faster than 8 on grids from 40×30 to 320×160
_ALL = (-np.inf, np.inf)


@dataclass(frozen=True)
class ElementGrid:
    """Elements of one patch, or of one part of it, in block order, fixed frame.

    centres_mm, normals (m, 3); areas_mm2 (m,); edge_centres_mm (k, 3) of the outermost elements;
    blocks (b + 1,) first element of each block;
    block_centres_mm (b, 3); block_extents_mm (b, 3) half the size of the box about each block's element centres.
    """

    centres_mm: Array
    normals: Array
    areas_mm2: Array
    edge_centres_mm: Array
    blocks: np.ndarray
    block_centres_mm: Array
    block_extents_mm: Array


def _plane(x: Array, z: Array) -> tuple[Array, Array]:
    normals = np.zeros((*x.shape, 3))
    normals[..., 1] = 1.0
    return np.zeros_like(x), normals


def _dish(x: Array, z: Array, sagittal_radius: float, frontal_radius: float) -> tuple[Array, Array]:
    """Concave torus piece, lowest at y = 0: a frontal arc r swept about the axis y = R parallel to z."""
    offset = sagittal_radius - frontal_radius
    tube = np.sqrt(frontal_radius**2 - z**2)
    rho = offset + tube
    y = sagittal_radius - np.sqrt(rho**2 - x**2)
    # Towards the centre of the frontal arc, which lies at distance `offset` from the axis.
    inward = np.stack([-x, sagittal_radius - y], axis=-1) / rho[..., None]
    normals = np.stack([inward[..., 0] * tube, inward[..., 1] * tube, -z], axis=-1) / frontal_radius
    return y, normals


def _grid(nx: int, nz: int, length: float, width: float) -> tuple[Array, Array, float]:
    x = ((np.arange(nx) + 0.5) / nx - 0.5) * length
    z = ((np.arange(nz) + 0.5) / nz - 0.5) * width
    return *np.meshgrid(x, z, indexing="ij"), (length / nx) * (width / nz)


def _grid_elements(centres: Array, normals: Array, areas: Array, z_mm: tuple[float, float] = _ALL) -> ElementGrid:
    """Elements of a grid of cells (nx, nz) between z_mm, less those of no area; at its edge or beside one of these is
    outermost."""
    nx, nz = areas.shape
    present = areas > 0.0
    inner = np.zeros((nx, nz), dtype=bool)
    inner[1:-1, 1:-1] = present[2:, 1:-1] & present[:-2, 1:-1] & present[1:-1, 2:] & present[1:-1, :-2]
    present &= _between(centres[..., 2], z_mm)
    index = np.arange(nx * nz).reshape(nx, nz)
    blocks = []
    for i in range(0, nx, BLOCK_SIDE):
        for k in range(0, nz, BLOCK_SIDE):
            cells = (slice(i, i + BLOCK_SIDE), slice(k, k + BLOCK_SIDE))
            blocks.append(index[cells][present[cells]])
    edge = centres[present & ~inner]
    return _in_blocks(centres.reshape(-1, 3), normals.reshape(-1, 3), areas.ravel(), edge, blocks)


def _halved(centres: Array, members: np.ndarray) -> list[np.ndarray]:
    """Groups of at most BLOCK_SIDE² neighbouring elements, by halving along the longest extent."""
    if len(members) <= BLOCK_SIDE**2:
        return [members]
    axis = int(np.argmax(np.ptp(centres[members], axis=0)))
    ordered = members[np.argsort(centres[members, axis])]
    return [group for half in np.array_split(ordered, 2) for group in _halved(centres, half)]


def _between(z: Array, bounds: tuple[float, float]) -> np.ndarray:
    return np.asarray((z >= bounds[0]) & (z < bounds[1]))


def _in_blocks(centres: Array, normals: Array, areas: Array, edge: Array, blocks: list[np.ndarray]) -> ElementGrid:
    blocks = [block for block in blocks if block.size]
    starts = np.cumsum([0, *(block.size for block in blocks)], dtype=np.int64)
    flat = np.concatenate([np.zeros(0, dtype=np.int64), *blocks])
    centres, normals, areas = centres[flat], normals[flat], areas[flat]
    spans = list(itertools.pairwise(starts))
    low = np.array([centres[a:b].min(axis=0) for a, b in spans]).reshape(-1, 3)
    high = np.array([centres[a:b].max(axis=0) for a, b in spans]).reshape(-1, 3)
    return ElementGrid(centres, normals, areas, edge, starts, 0.5 * (low + high), 0.5 * (high - low))


def _mesh_elements(
    scene: Scene, patch: str, grid: tuple[int, int], z_ranges_mm: Sequence[tuple[float, float]]
) -> list[ElementGrid]:
    """Elements of a patch, one grid or its triangles, shared out among ranges of z by their centres."""
    field = body_field(scene, "fixed")
    if scene.geometry["elements"] == "grid":
        reaching = patch_mesh(scene, patch, reaching=True)
        cells = grid_on_mesh(reaching, field, grid, patch_box(scene, patch))
        return [_grid_elements(*cells, z_mm) for z_mm in z_ranges_mm]
    mesh = patch_mesh(scene, patch)
    centres, normals, areas = triangles_on_mesh(mesh, field)
    edge, found = open_triangles(mesh), []
    for z_mm in z_ranges_mm:
        inside = _between(centres[:, 2], z_mm)
        found.append(
            _in_blocks(centres, normals, areas, centres[edge & inside], _halved(centres, np.flatnonzero(inside)))
        )
    return found


def build_part_elements(scene: Scene, grid: tuple[int, int]) -> list[ElementGrid]:
    """The elements of each part of a mesh scene's patches, in part order: those of its patch, shared out by their z.

    Raises ValueError for a part without elements.
    """
    found = []
    for p, patch in enumerate(scene.patch_names):
        found += _mesh_elements(scene, patch, grid, [part.z_mm for part in scene.parts if part.patch == p])
    for part, elements in zip(scene.parts, found, strict=True):
        if not len(elements.areas_mm2):
            raise ValueError(f"scene {scene.name}: the part {part.name} holds no element: check split_z")
    return found


def build_elements(scene: Scene, grid: tuple[int, int]) -> list[ElementGrid]:
    """The element grid (nx along x, nz along z) of each patch of the scene, in patch order.

    A mesh scene whose elements are its triangles has these instead, whatever the grid.
    """
    if scene.shape == "mesh":
        return [_mesh_elements(scene, patch, grid, [_ALL])[0] for patch in scene.patch_names]
    if scene.shape in JOINT_PARAMETERS:
        return [_grid_elements(*patch) for patch in joint_elements(scene.shape, scene.geometry, grid)]
    grids = []
    for patch, anchor in zip(scene.patch_names, scene.anchors_mm, strict=True):
        if scene.shape == "knee":
            g = scene.geometry_of(patch)
            x, z, cell = _grid(*grid, g["plateau_length"], g["plateau_width"])
            y, normals = _dish(x, z, g["dish_sagittal_radius"], g["dish_frontal_radius"])
        elif scene.shape == "sphere_in_dish":
            g = dict(scene.geometry)
            x, z, cell = _grid(*grid, g["patch_side"], g["patch_side"])
            y, normals = _dish(x, z, g["dish_radius"], g["dish_radius"])
        else:
            g = dict(scene.geometry)
            side = g["patch_side"] if "patch_side" in g else g["area"] ** 0.5
            x, z, cell = _grid(*grid, side, g.get("length", side))
            y, normals = _plane(x, z)
        centres = np.stack([x, y, z + anchor[2]], axis=-1)
        grids.append(_grid_elements(centres, normals, cell / normals[..., 1]))
    return grids
