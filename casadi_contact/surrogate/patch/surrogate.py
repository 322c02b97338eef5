"""The patch surrogate (docs/method.md).

Patch p with local pose x_p has a signed root load s_p(x_p) and ratios ρ_pk(x_p):

    N_p = N0·max(s_p, 0)²,   wrench component along the sensitive load: ±N_p,   every other component k: N_p·ρ_pk

so that loads vanish exactly out of contact and nothing ever pulls. All six components are ratios where the normal
load is the magnitude of the force (`scenes.normal_load`). Networks are named ``root_med`` and ``ratios_med``; the
second gives all ratios of a patch that the scene's loads need, from shared hidden neurons.

A patch that a scene cuts into parts (`scenes.normal_load`) has these networks for each part (``root_med_1``); its
wrench is the sum over its parts. Its root load is the smooth union of theirs (`structures.patch.roots`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import WRENCH_NAMES, Array, pose_or_poses
from casadi_contact.networks.graph import Expressions
from casadi_contact.networks.kernel.source import Kernel
from casadi_contact.networks.network import Network, Regression
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.arrays import map_in_chunks
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.patch.graph import patch_expressions
from casadi_contact.surrogate.patch.kernel import patch_kernel
from casadi_contact.surrogate.patch.local_pose import local_pose_jacobian, local_poses
from casadi_contact.surrogate.patch.networks import (
    PatchNetworks,
    ratio_outputs,
    ratios_name,
    reflected,
    root_name,
    with_all_inputs,
)
from casadi_contact.surrogate.patch.roots import patch_root_expressions, patch_roots

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples


class _Part(NamedTuple):
    """What a part's wrench is made of: its anchor [mm]; its networks of a whole local pose, None where it has none; the
    wrench components (columns) of the ratios, and of the normal load itself: ±1 there, else zero (own, (6,))."""

    anchor_mm: Array
    root: Any
    ratios: Any
    columns: list[int]
    own: Array


class PatchSurrogate(Surrogate):
    """A network of the root load and one of all ratios per patch."""

    structure = "patch"
    title = "patch surrogate"
    budget_shares: ClassVar[Mapping[str, float]] = {"ratios": 0.2}  # smoother than a root load, and sooner good enough

    @classmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """Root loads, and ratios where the scene's loads need any, of every part; inputs are the free columns of the
        local pose (6 where none is locked)."""
        names = [*(root_name(part.name) for part in scene.parts), *ratio_outputs(scene)]
        return dict.fromkeys(names, len(scene.pose_space.free))

    @classmethod
    def network_outputs(cls, scene: Scene) -> dict[str, int]:
        """1 for a root load, the number of its ratios for a network of ratios."""
        ratios = {name: len(components) for name, components in ratio_outputs(scene).items()}
        return {name: ratios.get(name, 1) for name in cls.network_inputs(scene)}

    @staticmethod
    def regressions(samples: Samples) -> list[Regression]:
        """One regression per network; see `patch.regressions` for the formulas."""
        from casadi_contact.surrogate.patch.regressions import patch_regressions

        return patch_regressions(samples)

    @classmethod
    def twins(cls, scene: Scene) -> dict[str, str]:
        """Networks of the second part of a symmetric joint: mirror images of those of the first. None where the scene
        needs other ratios of the second part than of the first."""
        if not scene.symmetric:
            return {}
        first, second = (part.name for part in scene.parts)
        of_first, of_second = (ratio_outputs(scene).get(ratios_name(part)) for part in (first, second))
        if of_first != of_second:
            return {}
        ratios = {ratios_name(second): ratios_name(first)} if of_first else {}
        return {root_name(second): root_name(first), **ratios}

    @staticmethod
    def reflection(name: str, network: Network, scene: Scene) -> Network:
        """The twin `name` of a network: its reflection in the plane z = 0."""
        return reflected(network, scene.pose_space.free, ratio_outputs(scene).get(name, (None,)))

    @classmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        """Of every part that the loads need: its root load, and its ratios where a load is made of one."""
        selection = scene.part_selection(loads)
        names = []
        for p, part in enumerate(scene.parts):
            used = [k for c, k in enumerate(WRENCH_NAMES) if selection[:, p, c].any()]
            if used:
                names.append(root_name(part.name))
            if any(k != part.normal.component for k in used):
                names.append(ratios_name(part.name))
        return names

    def _root_networks(self) -> list[str]:
        return [root_name(part.name) for part in self.scene.parts]

    @cached_property
    def _evaluated(self) -> dict[str, Network]:
        """The networks, each as a function of a whole local pose."""
        free = self.scene.pose_space.free
        return {name: with_all_inputs(network, free) for name, network in self.networks.items()}

    @cached_property
    def _parts(self) -> list[_Part]:
        parts, outputs = [], ratio_outputs(self.scene)
        for part in self.scene.parts:
            name, own = ratios_name(part.name), np.zeros(6)
            if part.normal.component is not None:
                own[WRENCH_NAMES.index(part.normal.component)] = part.normal.sign
            columns = [WRENCH_NAMES.index(component) for component in outputs.get(name, ())]
            root, ratios = self._evaluated.get(root_name(part.name)), self._evaluated.get(name)
            parts.append(_Part(part.anchor_mm, root, ratios, columns, own))
        return parts

    @cached_property
    def _selections(self) -> dict[tuple[str, ...], Array]:
        return {}

    def _selection(self, loads: Sequence[str]) -> Array:
        """`Scene.part_selection` (L, parts, 6), kept for the next call."""
        if (key := tuple(loads)) not in self._selections:
            self._selections[key] = self.scene.part_selection(loads)
        return self._selections[key]

    @cached_property
    def _bound(self) -> PoseSpace | None:
        """The scene's pose space where it locks or ties a parameter."""
        return None if self.scene.pose_space.unconstrained else self.scene.pose_space

    def _loads(self, poses: Array, loads: Sequence[str], *, derivative: bool) -> tuple[Array, Array]:
        selection = self._selection(loads)
        values, jacobian = np.zeros((len(poses), len(loads))), np.zeros((len(poses) * derivative, len(loads), 6))
        for p in np.flatnonzero(selection.any(axis=(0, 2))).tolist():
            _, _, wrench, d_wrench = self._part(
                poses, p, np.asarray(selection[:, p].any(axis=0)), derivative=derivative
            )
            values += wrench @ selection[:, p].T
            jacobian += selection[:, p] @ d_wrench
        return values, jacobian

    def _roots(self, poses: Array, *, derivative: bool) -> tuple[Array, Array]:
        none = np.zeros(6, dtype=bool)
        parts = [self._part(poses, p, none, derivative=derivative) for p in range(len(self.scene.parts))]
        return self._of_patches([part[:2] for part in parts])

    def _jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        selection = self._selection(self.load_names)
        values, jacobian = np.zeros((len(poses), len(selection))), np.zeros((len(poses), len(selection), 6))
        roots = []
        for p in range(len(self.scene.parts)):
            s, ds, wrench, d_wrench = self._part(poses, p, np.asarray(selection[:, p].any(axis=0)), derivative=True)
            values += wrench @ selection[:, p].T
            jacobian += selection[:, p] @ d_wrench
            roots.append((s, ds))
        return values, jacobian, *self._of_patches(roots)

    def _of_patches(self, parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Root loads (n, P) and their derivatives of the patches, from those of all parts."""
        s, ds = (np.stack(columns, axis=1) for columns in zip(*parts, strict=True))
        return patch_roots(s, ds, self.scene.first_parts)

    @pose_or_poses
    def wrenches(self, poses: Array) -> Array:
        """Wrench of every patch, (n, P, 6), or (P, 6) for a pose (6,); raises ValueError if a network is missing."""
        self.check_loads([f"{component}_{patch}" for patch in self.patch_names for component in WRENCH_NAMES])
        used = np.ones(6, dtype=bool)

        def of_patches(block: Array) -> Array:
            parts = range(len(self.scene.parts))
            of_parts = np.stack([self._part(block, p, used, derivative=False)[2] for p in parts], axis=1)
            return np.add.reduceat(of_parts, self.scene.first_parts, axis=1)

        return map_in_chunks(of_patches, poses)

    def _part(self, poses: Array, p: int, used: np.ndarray, *, derivative: bool) -> tuple[Array, Array, Array, Array]:
        """Root load s (n,) of part p and its wrench W (n, 6), as s, ds/dpose (n, 6), W, dW/dpose (n, 6, 6).

        used (6,): the wrench components that are needed; all ratios are zero where it needs none of them. Derivatives
        are (0, 6) and (0, 6, 6) if not asked for.
        """
        part, space, n0 = self._parts[p], self._bound, self.scene.reference_load
        on_space = poses if space is None else space.project(poses)
        x, by_pose = local_poses(on_space, part.anchor_mm), np.empty((0, 6, 6))
        if derivative:
            by_pose = local_pose_jacobian(on_space, part.anchor_mm)
            by_pose = by_pose if space is None else space.pull_back(by_pose)
        s, ds = _in_pose(part.root, x, by_pose)
        ratios, d_ratios = np.tile(part.own, (len(x), 1)), np.zeros((len(by_pose), 6, 6))
        if (used & (part.own == 0.0)).any():
            values, gradients = _in_pose(part.ratios, x, by_pose)
            ratios[:, part.columns] = values.reshape(len(x), len(part.columns))
            d_ratios[:, part.columns] = gradients.reshape(len(by_pose), len(part.columns), 6)
        contact = np.maximum(s, 0.0)
        normal, d_normal = n0 * contact**2, 2.0 * n0 * contact[: len(ds), None] * ds
        d_wrench = ratios[: len(ds), :, None] * d_normal[:, None] + normal[: len(ds), None, None] * d_ratios
        return s, ds, normal[:, None] * ratios, d_wrench

    def _root_count(self) -> int:
        return len(self.scene.parts)

    def _first_roots(self) -> Sequence[int]:
        return self.scene.first_parts

    def _patch_roots(self, roots: ca.MX) -> ca.MX:
        return patch_root_expressions(roots, self.scene.first_parts)

    def _expressions(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        parts, selection = self.known_parts(loads)
        return patch_expressions(parts, selection, self.scene.reference_load, pose, order, self.scene.pose_space)

    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        parts, selection = self.known_parts(loads)
        if not roots:
            used = np.flatnonzero(selection.any(axis=(0, 2)))
            parts, selection = [parts[p] for p in used], selection[:, used]
        return patch_kernel(parts, selection, self.scene.reference_load, self.scene.pose_space)

    def known_parts(self, loads: Sequence[str]) -> tuple[list[PatchNetworks], Array]:
        """The parts whose root is known, and what of the loads' selection (L, parts, 6) is theirs."""
        known = [p for p, name in enumerate(self._root_networks()) if name in self.networks]
        of_parts = []
        for part in (self.scene.parts[p] for p in known):
            name, normal = ratios_name(part.name), part.normal
            components = ratio_outputs(self.scene).get(name, ())
            root, ratios = self._evaluated[root_name(part.name)], self._evaluated.get(name)
            of_parts.append(
                PatchNetworks(part.name, part.anchor_mm, normal.component, root, ratios, components, normal.sign)
            )
        return of_parts, self.scene.part_selection(loads)[:, known]


def _in_pose(network: Network, x: Array, by_pose: Array) -> tuple[Array, Array]:
    """Value (n,) of a network at local poses x (n, 6) and its derivative by the pose (n, 6), (n, m) and (n, m, 6) for m
    outputs; no rows of derivatives where by_pose (n, 6, 6) has none."""
    if len(by_pose) < len(x):
        return network.value(x), np.empty((0, 6))
    value, gradient = network.value_and_gradient(x)
    return value, np.einsum("n...i,nij->n...j", gradient, by_pose)
