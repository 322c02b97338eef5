"""The elastic foundation (EF): the original contact model that samples come from ([EF15 §3.1], Bei and Fregly 2004)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from casadi_contact.contact.elements.loops import (
    gap_many,
    near_elements,
    overlap_many,
    point_distances,
    wrench_many,
)
from casadi_contact.contact.friction import PressedPoints, SlidingContact, checked_velocities
from casadi_contact.contact.pressure_law import law_of, pressure_derivatives, pressures
from casadi_contact.contact.pressures import PressureMap, PressureSummary
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import (
    Array,
    as_poses,
    batched,
    rotation,
    twist_to_pose_gradient,
    wrench_about_origin,
)
from casadi_contact.core.threads import in_shares
from casadi_contact.geometry.elements import ElementGrid, scattered_elements
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.geometry.triangle_mesh import beside_creases, creases
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import grid_size
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, field_spacing

EDGE_MM = 1.0  # from the outermost elements


def grid_text(grid: tuple[int, int]) -> str:
    """Elements per side as people write them: "80×40"."""
    return f"{grid[0]}×{grid[1]}"


def _boxes(e: ElementGrid) -> Array:
    """Middle and three half axes (blocks, 12) of boxes about the blocks' elements, flat along their mean normals."""
    starts = e.blocks[:-1]
    normals = np.add.reduceat(e.normals, starts)
    across = np.eye(3)[np.abs(normals).argmin(axis=1)]
    frames = np.linalg.qr(np.stack([normals, across, np.ones_like(normals)], -1))[0]
    along = np.einsum("ei,eik->ek", e.centres_mm, np.repeat(frames, np.diff(e.blocks), axis=0))
    low, high = np.minimum.reduceat(along, starts), np.maximum.reduceat(along, starts)
    middle = np.einsum("bik,bk->bi", frames, 0.5 * (low + high))
    axes = (0.5 * (high - low))[:, :, None] * np.swapaxes(frames, 1, 2)
    return np.concatenate([middle, axes.reshape(-1, 9)], 1)


class PatchElements(NamedTuple):
    """An `ElementGrid` as numba's loops read it, the surface that faces it, and the law's number, K and h (m,)."""

    surface: MovingSurface
    elements: tuple[Array, Array, Array, np.ndarray, Array]
    law: tuple[int, float, Array]

    @classmethod
    def of(cls, surface: MovingSurface, e: ElementGrid, scene: Scene | None) -> PatchElements:
        """scene: None for gaps alone."""
        law = (0, np.nan, np.zeros(0))
        if scene is not None:
            law = *law_of(scene.material)[:2], scene.thickness_at(e.centres_mm, e.normals)
        centres, normals, boxes = (np.ascontiguousarray(part.T) for part in (e.centres_mm, e.normals, _boxes(e)))
        return cls(surface, (centres, normals, e.areas_mm2, e.blocks, boxes), law)

    def wrenches(self, rotations: Array, translations: Array, *, derivatives: bool) -> tuple[Array, Array]:
        """Wrenches (n, 6) and, if asked, d wrench / d twist (n, 6, 6)."""
        s = self.surface
        loop = partial(wrench_many, s.family, s.parameters, self.elements, *self.law, derivatives)
        return _of_shares(loop, rotations, translations)


class ElasticFoundation(SlidingContact):
    """A bed of independent springs on the fixed body, pressed by the rigid moving body.

    The wrench of a patch on the fixed body is Σ -p(d_i)·A_i·(n_i, c_i × n_i) over its elements, with d_i the depth
    along the element's normal. Each method takes poses (n, 6), side by side on threads, or one pose (6,).

    grid: elements per patch (nx, nz), the scene's fine grid if left out.
    """

    def __init__(self, scene: Scene, grid: tuple[int, int] | None = None) -> None:
        super().__init__(scene)
        _ = scene.material  # a scene without geometry says so
        self.grid = scene.grids["fine"] if grid is None else grid_size("grid", grid)
        grids = scene.elements(self.grid)
        self._edges = [np.ascontiguousarray(e.edge_centres_mm.T) for e in grids]
        self._patches = [PatchElements.of(s, e, scene) for s, e in zip(scene.surfaces(), grids, strict=True)]

    def __repr__(self) -> str:
        return f"ElasticFoundation({self.scene.name}, grid={grid_text(self.grid)})"

    @property
    def label(self) -> str:
        """Its name in tables: "EF 80×40"."""
        return f"EF {grid_text(self.grid)}"

    @batched
    def wrenches(self, poses: Array, velocities: ArrayLike | None = None) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm]; velocities: see `SlidingContact`."""
        if velocities is not None:
            return self.moving_wrenches(poses, checked_velocities(poses, velocities))
        return self._evaluate(self._patches, poses, derivatives=False)[0]

    def pressed_points(self, poses: Array) -> Iterator[list[PressedPoints]]:
        """Of each pose (n, 6), of each patch, the elements that bear load."""
        for pose in poses:
            beds = zip(self._patches, self._unit_loads, strict=True)
            yield [self._pressed(*bed, rotation(pose[3:]), pose[:3].copy()) for bed in beds]

    @cached_property
    def _unit_loads(self) -> list[Array]:
        """(n, c × n) (m, 6) of each patch's elements."""
        return [wrench_about_origin(bed.elements[1].T, bed.elements[0].T) for bed in self._patches]

    def _pressed(self, bed: PatchElements, loads: Array, R: Array, t: Array) -> PressedPoints:
        surface, (centres, normals, areas, *_) = bed.surface, bed.elements
        near = near_elements(surface.family, surface.parameters, bed.elements, R, t)
        points, along = np.ascontiguousarray(centres[:, near]), np.ascontiguousarray(normals[:, near])
        depths, by_twist = overlap_many(surface.family, surface.parameters, points, along, R, t, 0.0)
        pressed = depths > 0.0
        depths, by_twist, on = depths[pressed], by_twist[pressed], near[pressed]
        number, modulus, thickness = bed.law
        p, slope = pressure_derivatives(number, modulus, thickness[on], depths)
        area = areas[on]
        return PressedPoints(
            centres[:, on].T, normals[:, on].T, loads[on], p * area, (slope * area)[:, None] * by_twist
        )

    def function(self, loads: Iterable[str] | None = None, name: str = "contact_loads", **options: Any) -> ca.Function:
        """`ContactFunctions.function` of this model called back from CasADi."""
        return symbolic(self).function(loads, name, **options)

    @batched
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their analytic derivatives by the pose (n, patches, 6, 6)."""
        return self._evaluate(self._patches, poses, derivatives=True)

    @batched
    def gaps(self, poses: Array) -> Array:
        """Distance of each patch (n, patches) [mm] from the moving body; below zero, minus the largest overlap."""
        return self._gaps(self._patches, poses)[0]

    @batched
    def at_edge(self, poses: Array) -> np.ndarray:
        """True (n, patches) where contact reaches a patch's outermost elements: part of it may lie beyond them."""
        rotations, translations = rotation(poses[:, 3:]), np.ascontiguousarray(poses[:, :3])
        touched = [
            [
                (point_distances(s.family, s.parameters, edge, *pose) < 0.0).any()
                for (s, *_), edge in zip(self._patches, self._edges, strict=True)
            ]
            for pose in zip(rotations, translations, strict=True)
        ]
        return np.array(touched, dtype=bool).reshape(len(poses), len(self._patches))

    @batched
    def edge_wrenches(self, poses: Array) -> Array:
        """What elements within 1 mm of the outermost carry (n, patches, 6): as much may lie beyond them."""
        return self._evaluate(self._edge_patches, poses, derivatives=False)[0]

    @batched
    def edge_share(self, poses: Array) -> Array:
        """Share (n, patches) of each patch's force, by size, that `edge_wrenches` hold; 0 out of contact."""
        edge, whole = (np.linalg.norm(of(poses)[..., :3], axis=2) for of in (self.edge_wrenches, self.wrenches))
        return np.asarray(np.divide(edge, whole, where=whole > 0.0, out=np.zeros(whole.shape)))

    def pressure_maps(self, pose: Array) -> list[PressureMap]:
        """Pressure of every element in one pose (6,), patch by patch."""
        (position,) = as_poses([pose])
        return [
            PressureMap(patch, bed.elements[0].T, bed.elements[2], pressures(*bed.law, depths))
            for patch, (bed, depths) in zip(self.patch_names, self._depths(position), strict=True)
        ]

    def summary(self, poses: Array) -> PressureSummary:
        """Areas, pressures, centres of pressure and penetrations of each patch at poses (n, 6), over its elements."""
        poses = as_poses(poses)
        found = (
            (n, p, bed.elements[0].T, bed.elements[2], depths, pressures(*bed.law, depths))
            for n, pose in enumerate(poses)
            for p, (bed, depths) in enumerate(self._depths(pose))
        )
        return PressureSummary.of_elements((len(poses), len(self.patch_names)), found)

    def distances(self, points_mm: Array, pose: Array, patch: str) -> Array:
        """Signed distances (m,) [mm] of fixed-frame points (m, 3) from the moving surface that faces a patch."""
        (position,) = as_poses([pose])
        surface = self._patches[self.patch_names.index(patch)].surface
        points = np.ascontiguousarray(np.asarray(points_mm, dtype=float).T)
        return point_distances(surface.family, surface.parameters, points, rotation(position[3:]), position[:3].copy())

    def _depths(self, pose: Array) -> Iterator[tuple[PatchElements, Array]]:
        """Elements, and their depths (m,) [mm] in one pose, patch by patch."""
        R, t = rotation(pose[3:]), pose[:3].copy()
        for bed in self._patches:
            surface = bed.surface.family, bed.surface.parameters
            yield bed, np.maximum(overlap_many(*surface, *bed.elements[:2], R, t, 0.0)[0], 0.0)

    @cached_property
    def _edge_patches(self) -> list[PatchElements]:
        """The patches' beds, of elements at an edge alone."""
        beds = []
        for (surface, elements, *_), edge in zip(self._patches, self._edges, strict=True):
            centres, normals, areas = elements[0].T, elements[1].T, elements[2]
            near = cKDTree(edge.T).query(centres)[0] <= EDGE_MM if edge.size else np.zeros(len(centres), dtype=bool)
            at_edge = scattered_elements(centres[near], normals[near], areas[near], near[near])
            beds.append(PatchElements.of(surface, at_edge, self.scene))
        return beds

    def _evaluate(self, beds: Sequence[PatchElements], poses: Array, *, derivatives: bool) -> tuple[Array, Array]:
        """Wrenches (n, beds, 6) and, if asked, d wrench / d pose (n, beds, 6, 6)."""
        rotations, translations = rotation(poses[:, 3:]), np.ascontiguousarray(poses[:, :3])
        results = [bed.wrenches(rotations, translations, derivatives=derivatives) for bed in beds]
        wrenches = np.stack([w for w, _ in results], axis=1)
        if not derivatives:
            return wrenches, np.empty(0)
        return wrenches, twist_to_pose_gradient(np.stack([k for _, k in results], axis=1), poses)

    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""
        return self._gaps(self._patches, poses)

    def _gaps(self, beds: Sequence[PatchElements], poses: Array) -> tuple[Array, Array]:
        """Gaps (n, beds) and their derivatives by pose (n, beds, 6)."""
        rotations, translations = rotation(poses[:, 3:]), np.ascontiguousarray(poses[:, :3])
        results = [
            _of_shares(partial(gap_many, s.family, s.parameters, e), rotations, translations) for s, e, *_ in beds
        ]
        gradients = twist_to_pose_gradient(np.stack([g for _, g in results], axis=1), poses)
        return np.stack([g for g, _ in results], axis=1), gradients


def _of_shares(loop: Callable[[Array, Array], tuple[Array, ...]], rotations: Array, translations: Array) -> Any:
    """A tuple of arrays with a row for each pose, by a loop over shares of the poses."""
    if len(rotations) < 16:  # no work for two threads
        return loop(rotations, translations)
    found = in_shares(len(rotations), lambda p: loop(rotations[p], translations[p]), rows_of_a_thread=8, multiple=1)
    return found[0] if len(found) == 1 else tuple(map(np.concatenate, zip(*found, strict=True)))


def pressed_elements(model: ElasticFoundation, pose: Array) -> tuple[Array, Array]:
    """Centres (m, 3) [mm] of the elements that bear load and their forces p·A (m,) [N]."""
    maps = model.pressure_maps(pose)
    force = np.concatenate([each.forces_n for each in maps])
    return np.concatenate([each.centres_mm for each in maps])[force > 0.0], force[force > 0.0]


def share_of_force(model: ElasticFoundation, poses: Array, chosen: Callable[[Array], np.ndarray]) -> Array:
    """Share (n,) of the force Σ p·A on elements chosen by their places (m, 3) in the moving frame; 0 out of contact."""
    pressed, share = [pressed_elements(model, pose) for pose in poses], np.zeros(len(poses))
    at = np.repeat(np.arange(len(poses)), [len(force) for _, force in pressed])
    if not len(at):
        return share
    seen = [(points - pose[:3]) @ rotation(pose[3:]) for (points, _), pose in zip(pressed, poses, strict=True)]
    force = np.concatenate([each for _, each in pressed])
    there = chosen(np.concatenate(seen))
    total, on = np.bincount(at, force, len(poses)), np.bincount(at[there], force[there], len(poses))
    return np.asarray(np.divide(on, total, where=total > 0.0, out=share))


SHARP_SHARE = 0.1  # of a wheel with bare edges, with less of its load there forces are off by 1 %


def share_at_sharp_edges(model: ElasticFoundation, poses: Array) -> Array:
    """`share_of_force` (n,) nearer to a crease of the moving mesh than its distance field's spacing.

    There the field rounds the edge off, for elements and cells alike. 0 for moving bodies without creases.
    """
    poses, geometry = as_poses(poses), model.scene.geometry
    if model.scene.shape != "mesh" or not len(creases(mesh := body_mesh(geometry, "moving"))[0]):
        return np.zeros(len(poses))
    spacing, faces = field_spacing(geometry, "moving"), np.arange(len(mesh.faces))
    return share_of_force(model, poses, lambda points: beside_creases(mesh, points, faces, spacing))
