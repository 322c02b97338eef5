"""Finite elements as a contact model: a rigid moving body pressed into the fixed body's elastic layer, frictionless."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.optimize import nnls
from threadpoolctl import ThreadpoolController

from casadi_contact.contact.elements.foundation import ElasticFoundation, PatchElements, grid_text
from casadi_contact.contact.elements.loops import overlap_many
from casadi_contact.contact.finite_elements.layer import Hexahedra, Layer
from casadi_contact.contact.model import WrenchLoads
from casadi_contact.contact.pressures import PressureMap, PressureSummary
from casadi_contact.core.conventions import (
    Array,
    as_poses,
    batched,
    rotation,
    twist_to_pose_gradient,
)
from casadi_contact.geometry.elements import scattered_elements
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import grid_size
from casadi_contact.scenes.shapes.shape import shape_named


@dataclass(frozen=True)
class Pressed:
    """A patch's nodes in contact, by number (a,): overlaps (a,) [mm], forces (a,) [N] and the forces' derivatives by
    the twist of the moving body about t (a, 6)."""

    nodes: np.ndarray
    overlaps_mm: Array
    forces_n: Array
    by_twist: Array


class ElasticBody:
    """One patch: its condensed layer and the moving surface that faces it.

    In a pose with overlaps d (m,) along the normals, the forces f (m,) solve f ≥ 0, C·f - d ≥ 0, fᵀ(C·f - d) = 0.
    """

    def __init__(self, layer: Layer, surface: MovingSurface) -> None:
        self.layer, self.surface = layer, surface
        self.nodes = [np.ascontiguousarray(part.T) for part in (layer.points_mm, layer.normals)]
        self.wrenches = -np.concatenate([layer.normals, np.cross(layer.points_mm, layer.normals)], axis=1)
        inner = np.zeros(len(layer.points_mm), dtype=bool)  # no node counts as an edge: gaps alone are asked for
        nodes = scattered_elements(layer.points_mm, layer.normals, layer.areas_mm2, inner)
        self.elements = PatchElements.of(surface, nodes, None)

    def press(self, R: Array, t: Array, reach_mm: float) -> Pressed:
        """The forces in one pose; nodes farther than reach from the moving body are left out."""
        surface, layer = self.surface, self.layer
        overlaps, by_twist = overlap_many(surface.family, surface.parameters, *self.nodes, R, t, reach_mm)
        active = np.flatnonzero(active_set(layer.compliance, overlaps))
        if not len(active):
            return Pressed(active, np.zeros(0), np.zeros(0), np.zeros((0, 6)))
        solution = _solved(layer.compliance, active, np.column_stack([overlaps[active], by_twist[active]]))
        return Pressed(active, overlaps[active], solution[:, 0], solution[:, 1:])


def _solved(compliance: Array, active: np.ndarray, right: Array) -> Array:
    """C_AA⁻¹ times the right-hand sides (a, k)."""
    factor = cho_factor(compliance[np.ix_(active, active)], lower=True, check_finite=False)
    return np.asarray(cho_solve(factor, right, check_finite=False))


def active_set(compliance: Array, overlaps: Array, most_steps: int = 40) -> np.ndarray:
    """True (m,) where f > 0 in the solution of f ≥ 0, C·f ≥ d, fᵀ(C·f - d) = 0; d = -∞ far from the moving body.

    Primal-dual active set: with A given, f_A = C_AA⁻¹·d_A; the next A holds those of A with f > 0 and all others with
    C·f < d. Hertz's contact ends where d is half of its largest, that of a layer farther out: A starts from 0.3.
    Where this does not end, non-negative least squares of ½|Lᵀf - L⁻¹d|², C = L·Lᵀ, has the same solution.
    """
    active = overlaps > 0.3 * max(overlaps.max(initial=0.0), 0.0)
    if not active.any():
        return active
    for _ in range(most_steps):
        nodes = np.flatnonzero(active)
        rows, forces = compliance[nodes], _solved(compliance, nodes, overlaps[nodes])
        following = forces @ rows < overlaps
        following[nodes] = forces > 0.0
        if (following == active).all():
            return active
        active = following
    near = np.flatnonzero(overlaps > -np.inf)
    upper, active = cholesky(compliance[np.ix_(near, near)]), np.zeros(len(overlaps), dtype=bool)
    active[near] = nnls(upper, np.linalg.solve(upper.T, overlaps[near]))[0] > 0.0
    return active


class FiniteElements(WrenchLoads):
    """The fixed body as a linear elastic solid on a rigid back, pressed by the rigid moving body without friction.

    A layer of the scene's thickness, Young's modulus and Poisson's ratio lies under each patch; the scene's pressure
    law has no meaning here. The wrench of a patch on the fixed body is Σ -f_i·(n_i, x_i × n_i) over the nodes of its
    surface, with forces f_i ≥ 0 that keep every node out of the moving body. Jacobian: df = C_AA⁻¹·dd on the nodes A
    in contact. Each method takes poses (n, 6), or one pose (6,): its arrays then come without their first axis.

    grid: nodes of each patch along x and z; 1.5 times the scene's coarse grid if left out. mesh: its hexahedra.
    reach_mm: how far outside of the moving body nodes are followed that may bulge into it. The first use of a scene
    condenses its layers, in seconds to minutes, and keeps them in the cache folder. Raises ModuleNotFoundError
    without the extra `fem`, ValueError for a surface without whole elements.
    """

    def __init__(
        self,
        scene: Scene,
        grid: tuple[int, int] | None = None,
        mesh: Hexahedra = Hexahedra(),  # noqa: B008
        *,
        reach_mm: float = 0.3,
    ) -> None:
        super().__init__(scene)
        if scene.varies or scene.material.moving:
            raise ValueError(f"scene {scene.name}: finite elements take one layer of one thickness")
        nx, nz = [3 * count // 2 for count in scene.grids["coarse"]] if grid is None else grid_size("grid", grid)
        self.grid = nx - (nx - 1) % mesh.order, nz - (nz - 1) % mesh.order  # whole elements
        self.mesh, self.reach_mm = mesh, reach_mm
        self.record: dict[str, Any] = {}
        self._blas = ThreadpoolController()
        self._elements = ElasticFoundation(scene, self.grid)  # on the same points: it knows the rims
        self._bodies = []
        cells = shape_named(scene.shape).cells(scene.geometry, self.grid)
        for surface, (points, normals, areas) in zip(scene.surfaces(), cells, strict=True):
            layer = Layer.of(points, normals, areas > 0.0, scene.material, mesh)
            self._bodies.append(ElasticBody(layer, surface))

    def __repr__(self) -> str:
        return f"FiniteElements({self.scene.name}, grid={grid_text(self.grid)}, {self.mesh})"

    @property
    def label(self) -> str:
        """Its name in tables: "FE 61×41"."""
        return f"FE {grid_text(self.grid)}"

    def convergence(self, poses: Array) -> dict[str, Any]:
        """The convergence test, kept as ``record``: "rms", how far each load [N, N·mm] at poses (n, 6) is from that on
        elements 1.5 times as large, and "against", their label. Smaller elements change loads by less."""
        nx, nz = (1 + 2 * (count - 1) // 3 for count in self.grid)
        mesh = replace(self.mesh, layers=max(1, 2 * self.mesh.layers // 3))
        wider = FiniteElements(self.scene, (nx, nz), mesh, reach_mm=self.reach_mm)
        off = np.sqrt(np.mean((self(as_poses(poses)) - wider(as_poses(poses))) ** 2, axis=0))
        self.record = {"rms": dict(zip(self.load_names, off.tolist(), strict=True)), "against": wider.label}
        return self.record

    @batched
    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm], for poses (n, 6)."""
        wrenches = [
            found.forces_n @ body.wrenches[found.nodes]
            for pressed in self._pressed(poses)
            for body, found in zip(self._bodies, pressed, strict=True)
        ]
        return np.reshape(wrenches, (len(poses), len(self._bodies), 6))

    @batched
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their exact derivatives by the pose (n, patches, 6, 6)."""
        wrenches = np.zeros((len(poses), len(self._bodies), 6))
        by_twist = np.zeros((*wrenches.shape, 6))
        for k, pressed in enumerate(self._pressed(poses)):
            for p, (body, found) in enumerate(zip(self._bodies, pressed, strict=True)):
                unit = body.wrenches[found.nodes].T
                wrenches[k, p], by_twist[k, p] = unit @ found.forces_n, unit @ found.by_twist
        return wrenches, twist_to_pose_gradient(by_twist, poses)

    @batched
    def at_edge(self, poses: Array) -> np.ndarray:
        """True (n, patches) where contact reaches a patch's outermost points: part of it may lie beyond them."""
        return self._elements.at_edge(poses)

    @batched
    def edge_share(self, poses: Array) -> Array:
        """Share (n,) of the load that springs on the same grid carry at the patches' edges."""
        return self._elements.edge_share(poses)

    @batched
    def stored_energy(self, poses: Array) -> Array:
        """½·fᵀC f of each patch (n, patches) [N·mm]: the work that pressing the body into the layer took."""
        energies = [[0.5 * found.forces_n @ found.overlaps_mm for found in each] for each in self._pressed(poses)]
        return np.reshape(energies, (len(poses), len(self._bodies)))

    def pressure_maps(self, pose: Array) -> list[PressureMap]:
        """Pressure at every node in one pose (6,), patch by patch: its force over its area."""
        (pressed,) = self._pressed(as_poses([pose]))
        maps = []
        for name, body, found in zip(self.patch_names, self._bodies, pressed, strict=True):
            pressures = np.zeros(len(body.layer.areas_mm2))
            pressures[found.nodes] = found.forces_n / body.layer.areas_mm2[found.nodes]
            maps.append(PressureMap(name, body.layer.points_mm, body.layer.areas_mm2, pressures))
        return maps

    def summary(self, poses: Array) -> PressureSummary:
        """Areas, pressures, centres of pressure and penetrations of each patch at poses (n, 6), over its nodes."""
        poses = as_poses(poses)
        elements = []
        for k, pressed in enumerate(self._pressed(poses)):
            for p, (body, found) in enumerate(zip(self._bodies, pressed, strict=True)):
                areas = body.layer.areas_mm2[found.nodes]
                points, pressures = body.layer.points_mm[found.nodes], found.forces_n / areas
                elements.append((k, p, points, areas, found.overlaps_mm, pressures))
        return PressureSummary.of_elements((len(poses), len(self._bodies)), elements)

    def _pressed(self, poses: Array) -> Iterator[list[Pressed]]:
        """What each patch bears, pose by pose."""
        for R, t in zip(rotation(poses[:, 3:]), np.ascontiguousarray(poses[:, :3]), strict=True):
            with self._blas.limit(limits=1):  # matrices of some hundred rows are no work for two threads
                pressed = [body.press(R, t, self.reach_mm) for body in self._bodies]
            yield pressed

    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""
        return self._elements._gaps([body.elements for body in self._bodies], poses)
