"""The elastic foundation's elements in torch, for many poses at once on a GPU: as `contact.elements.loops`, in arrays.

Three steps, each on fewer numbers than the one before: blocks of elements that may touch (by the tangent at their
middle: the surfaces are convex), their elements that do (g < 0), and Newton's method for the depth of these. Sums over
the elements of a pose are made in a fixed order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from casadi_contact.bridges.torch_surfaces import FAMILIES, LAWS, Vector, signed_distance
from casadi_contact.contact import ElasticFoundation
from casadi_contact.contact.elements.loops import NEAREST_SURFACE, RAY_ITERATIONS, RAY_TOLERANCE_MM, STEEPEST_RAY_SLOPE
from casadi_contact.contact.pressure.law import layer_modulus
from casadi_contact.contact.twist import by_pose
from casadi_contact.conventions import Array, pose_or_poses, rotation, whole_number
from casadi_contact.geometry import MovingSurface
from casadi_contact.sampling import SamplingSettings, elastic_foundations
from casadi_contact.scenes import Material, Scene
from casadi_contact.training.arrays import torch_arrays

_BYTES_PER_BLOCK = 1000  # of a pose, at most: some 25 numbers a block, 20 for each element of a third of the blocks
_ROUNDING_MM = 1e-9
_MOST_POSES = 1 << 17
_CPU_BYTES = 1 << 26


@dataclass(frozen=True)
class FoundationsOn:
    """`sampling.elastic_foundations` evaluated on a torch device: the same contact model, so samples name it alike."""

    device: str
    stands_for = staticmethod(elastic_foundations)

    def __call__(self, scene: Scene, settings: SamplingSettings) -> tuple[TorchFoundation, TorchFoundation]:
        """On the settings' settle grid and teacher grid."""
        settle, teacher = (
            TorchFoundation(scene, grid, device=self.device) for grid in (settings.settle_grid, settings.teacher_grid)
        )
        return settle, teacher


class TorchFoundation(ElasticFoundation):
    """`ElasticFoundation` whose loads, gaps and edges are evaluated on a torch device, in double precision.

    The numbers are those of the elastic foundation to rounding. device: "cuda", "cuda:1", or "cpu" for tensors of the
    processor, which are slower than `ElasticFoundation`. poses_at_once: poses of a chunk; what fits into half of the
    free memory if left out. Raises ValueError for a device that cannot be had, and for a mesh or a pressure law that is
    not in `torch_surfaces`.
    """

    def __init__(
        self,
        scene: Scene,
        grid: tuple[int, int] | None = None,
        *,
        device: str = "cuda",
        poses_at_once: int | None = None,
    ) -> None:
        self._device = torch_arrays(device).device
        if any(surface.family not in FAMILIES for surface in scene.surfaces()):
            raise ValueError(f"scene {scene.name} is made of meshes, expected a parametric one on device {device!r}")
        if scene.material.law not in LAWS:
            known = ", ".join(LAWS)
            raise ValueError(f"pressure law {scene.material.law!r} on device {device!r}, expected one of {known}")
        super().__init__(scene, grid, compiled=False)
        self._beds: dict[int, _Bed] = {}
        blocks = max(len(bed.elements[4]) for bed in self._patches)
        at_once = _fitting(self._device, blocks) if poses_at_once is None else poses_at_once
        self._poses_at_once = whole_number("poses_at_once", at_once, 1)

    @pose_or_poses
    def at_edge(self, poses: Array) -> np.ndarray:
        """True (n, patches) where contact reaches a patch's outermost elements: part of it may lie beyond them."""

        def touches(surface: MovingSurface, edge: Array) -> Callable[..., torch.Tensor]:
            points = _tensor(edge.T, self._device)
            return lambda R, t: (signed_distance(surface, _to_moving(points, R, t))[0] < 0.0).any(1)

        pairs = zip(self._patches, self._edges, strict=True)
        return np.stack([self._in_chunks(touches(bed.surface, edge), poses) for bed, edge in pairs], axis=1)

    def _evaluate(self, beds: Sequence[Any], poses: Array, *, derivatives: bool) -> tuple[Array, Array]:
        asked = [partial(self._on_device(bed).wrenches, derivatives=derivatives) for bed in beds]
        found = np.stack([self._in_chunks(wrenches, poses) for wrenches in asked], axis=1)
        wrenches = np.ascontiguousarray(found[..., :6])
        if not derivatives:
            return wrenches, np.empty(0)
        return wrenches, by_pose(found[..., 6:].reshape(*found.shape[:2], 6, 6), poses)

    def _gaps(self, beds: Sequence[Any], poses: Array) -> tuple[Array, Array]:
        found = np.stack([self._in_chunks(self._on_device(bed).gaps, poses) for bed in beds], axis=1)
        return found[..., 0].copy(), by_pose(found[..., 1:], poses)

    def _on_device(self, bed: Any) -> _Bed:
        if id(bed) not in self._beds:
            self._beds[id(bed)] = _Bed(bed.surface, bed.elements, self.scene.material, self._device)
        return self._beds[id(bed)]

    def _in_chunks(self, found: Callable[..., torch.Tensor], poses: Array) -> np.ndarray:
        """found(rotations, translations) of poses (n, 6), chunk by chunk, as one array (n, ...)."""
        parts = []
        for start in range(0, max(len(poses), 1), self._poses_at_once):
            chunk = poses[start : start + self._poses_at_once] if len(poses) else np.zeros((1, 6))
            R = _tensor(rotation(chunk[:, 3:]).transpose(1, 2, 0), self._device)
            t = _tensor(chunk[:, :3].T, self._device)
            parts.append(found(R[..., None], t[..., None]).cpu().numpy())
        return np.concatenate(parts)[: len(poses)]


class _Bed:
    """The elements of a patch, block by block: (3, blocks, size), short blocks filled up with elements of no area.

    Poses come as rotations R (3, 3, n, 1) and translations t (3, n, 1): numbers that are worked on together lie so
    beside each other.
    """

    def __init__(
        self, surface: MovingSurface, elements: tuple[np.ndarray, ...], material: Material, device: torch.device
    ) -> None:
        centres, normals, areas, starts, middles, extents = elements
        sizes = np.diff(starts)
        place = np.arange(sizes.max())
        present = place < sizes[:, None]
        index = starts[:-1, None] + np.where(present, place, 0)
        self._surface, self._thickness = surface, material.thickness
        self._modulus, self._law = layer_modulus(material), LAWS[material.law]
        self._centres, self._normals = (_tensor(a[index].transpose(2, 0, 1), device) for a in (centres, normals))
        self._areas, self._present = _tensor(areas[index], device), torch.as_tensor(present, device=device)
        self._middles, self._extents = _tensor(middles.T, device), _tensor(extents.T, device)

    def wrenches(self, R: torch.Tensor, t: torch.Tensor, *, derivatives: bool) -> torch.Tensor:
        """Wrenches, and if asked d wrench / d twist row by row, (n, 6) or (n, 42)."""
        poses = R.shape[2]
        pose, block = torch.nonzero(self._least_distances(R, t) <= 0.0, as_tuple=True)
        g = self._distances(R, t, pose, block)
        pair, slot = torch.nonzero((g < 0.0) & self._present[block], as_tuple=True)
        pose, block, start = pose[pair], block[pair], -g[pair, slot]
        R, t = R[:, :, pose, 0], t[:, pose, 0]
        c, n, area = self._centres[:, block, slot], self._normals[:, block, slot], self._areas[block, slot]
        depth, G = self._depths(c, n, start, R, t)
        p, slope = self._law(self._modulus, self._thickness, depth)
        direction = torch.cat([-n, -torch.linalg.cross(c, n, dim=0)])
        rows = p * area * direction
        if derivatives:
            # g = 0 at c - d·n moves with the body: dd/dt = -G/(G·n), dd/dω = -((c - d·n - t) × G)/(G·n).
            scale = -slope * area / (G * n).sum(0).clamp(max=STEEPEST_RAY_SLOPE)
            by_twist = scale * torch.cat([G, torch.linalg.cross(c - depth * n - t, G, dim=0)])
            rows = torch.cat([rows, (direction[:, None] * by_twist[None]).flatten(0, 1)])
        return torch.segment_reduce(rows.T.contiguous(), "sum", lengths=torch.bincount(pose, minlength=poses))

    def gaps(self, R: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
        """Smallest g over the elements, and its derivative by twist, (n, 7)."""
        poses, bounds = R.shape[2], self._least_distances(R, t)
        most = self._distances(R, t, torch.arange(poses, device=R.device), bounds.argmin(1)).amin(1)
        pose, block = torch.nonzero(bounds <= most[:, None] + _ROUNDING_MM, as_tuple=True)
        g, slot = self._distances(R, t, pose, block).min(1)
        least = torch.segment_reduce(g, "min", lengths=torch.bincount(pose, minlength=poses))
        hits = torch.nonzero(g == least[pose])[:, 0]
        first = torch.full((poses,), len(g), device=R.device).scatter_reduce(0, pose[hits], hits, "amin")
        c, R, t = self._centres[:, block[first], slot[first]], R[..., 0], t[..., 0]
        slope = -_to_fixed(signed_distance(self._surface, _to_moving(c, R, t))[1], R)
        return torch.cat([least[None], slope, torch.linalg.cross(c - t, slope, dim=0)]).T

    def _least_distances(self, R: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
        """A lower bound (n, blocks) of g over each block: by its tangent at the middle, where g is convex."""
        g, gradient = signed_distance(self._surface, _to_moving(self._middles[:, None], R, t))
        return g - (_to_fixed(gradient, R).abs() * self._extents[:, None]).sum(0)

    def _distances(self, R: torch.Tensor, t: torch.Tensor, pose: torch.Tensor, block: torch.Tensor) -> torch.Tensor:
        """g (k, size) of the elements of these blocks (k,) at these poses (k,)."""
        return signed_distance(self._surface, _to_moving(self._centres[:, block], R[:, :, pose], t[:, pose]))[0]

    def _depths(
        self, c: torch.Tensor, n: torch.Tensor, start: torch.Tensor, R: torch.Tensor, t: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Depths d > 0 (k,) along -n of elements at c, and the surface's gradients (3, k) in the fixed frame there."""
        depth, least, going = start, NEAREST_SURFACE * start, torch.ones_like(start, dtype=torch.bool)
        G = torch.zeros_like(c)
        for _ in range(RAY_ITERATIONS):
            g, gradient = signed_distance(self._surface, _to_moving(c - depth * n, R, t))
            turned = _to_fixed(gradient, R)
            G = torch.where(going, turned, G)
            slope = (turned * n).sum(0).clamp(max=STEEPEST_RAY_SLOPE)
            after = torch.where(going, torch.maximum(depth + g / slope, least), depth)
            going, depth = going & ((after - depth).abs() >= RAY_TOLERANCE_MM), after
            if not going.any():
                break
        return depth, G


def _to_moving(p: torch.Tensor, R: torch.Tensor, t: torch.Tensor) -> Vector:
    """q = Rᵀ·(p - t), by component."""
    x, y, z = (p[i] - t[i] for i in range(3))
    return [R[0, j] * x + R[1, j] * y + R[2, j] * z for j in range(3)]


def _to_fixed(q: Vector, R: torch.Tensor) -> torch.Tensor:
    """R·q, the components first."""
    return torch.stack([R[i, 0] * q[0] + R[i, 1] * q[1] + R[i, 2] * q[2] for i in range(3)])


def _tensor(values: Array, device: torch.device) -> torch.Tensor:
    return torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float64, device=device)


def _fitting(device: torch.device, blocks: int) -> int:
    """Poses of a chunk that fit into half of a device's free memory, or well into a processor's."""
    free = torch.cuda.mem_get_info(device)[0] // 2 if device.type == "cuda" else _CPU_BYTES
    return max(1, min(_MOST_POSES, free // (_BYTES_PER_BLOCK * blocks)))
