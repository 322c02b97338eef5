"""The patch surrogate (docs/method.md).

Patch p with local pose x_p has a signed root load s_p(x_p) and ratios ρ_pk(x_p):

    N_p = N0·max(s_p, 0)²,   wrench component along the sensitive load: ±N_p,   every other component k: N_p·ρ_pk

so that loads vanish exactly out of contact and nothing ever pulls. All six components are ratios where the normal
load is the magnitude of the force (`scenes.normal_load`). Networks are named ``root_med`` and ``ratios_med``; the
second gives all ratios of a patch that the scene's loads need, from shared hidden neurons.

A patch that a scene cuts into parts (`scenes.parts`) has these networks for each part (``root_med_1``); its wrench is
the sum over its parts. Its root load is the smooth union of theirs (`structures.patch.roots`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import REFLECTION, WRENCH_NAMES, Array, load_jacobian, pose_or_poses
from casadi_contact.networks.graph import Expressions
from casadi_contact.networks.kernel.source import Kernel
from casadi_contact.networks.network import Network, Regression
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.parts import Part
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.blocks import in_blocks
from casadi_contact.surrogate.patch.graph import PatchNetworks, patch_expressions
from casadi_contact.surrogate.patch.kernel import patch_kernel
from casadi_contact.surrogate.patch.local_pose import LocalPoses, local_pose_jacobian, local_poses
from casadi_contact.surrogate.patch.mirror import equal_networks, reflected
from casadi_contact.surrogate.patch.names import ratios_name, root_name
from casadi_contact.surrogate.patch.roots import patch_root_expressions, patch_roots
from casadi_contact.surrogate.patch.targets import patch_regressions, ratio_outputs


def _used(selection: Array) -> np.ndarray:
    """Wrench components (parts, 6) that a selection (L, parts, 6) needs."""
    return np.asarray((selection != 0.0).any(axis=0))


def _parts(used: np.ndarray) -> np.ndarray:
    """Parts (parts,) that have a component (parts, 6) that is used."""
    return np.asarray(used.any(axis=1))


class _PartRoot(NamedTuple):
    """Root load (n,) of a part, and its derivative (n, 6), (0, 6) if not asked for."""

    at: LocalPoses
    s: Array
    ds: Array


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
        """One regression per network; see `patch_regressions` for the formulas."""
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

    def _loads(self, poses: Array, loads: Sequence[str]) -> Array:
        selection = self.scene.part_selection(loads)
        used = _used(selection)
        wrenches, _ = self._wrenches(self._part_roots(poses, _parts(used), derivative=False), used)
        return np.einsum("lpk,npk->nl", selection, wrenches)

    def _loads_and_jacobian(self, poses: Array, loads: Sequence[str]) -> tuple[Array, Array]:
        selection = self.scene.part_selection(loads)
        used = _used(selection)
        roots = self._part_roots(poses, _parts(used), derivative=True)
        return load_jacobian(selection, *self._wrenches(roots, used))

    def _jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        roots = self._part_roots(poses, derivative=True)
        selection = self.scene.part_selection(self.load_names)
        return *load_jacobian(selection, *self._wrenches(roots, _used(selection))), *self._of_patches(roots)

    @pose_or_poses
    def wrenches(self, poses: Array) -> Array:
        """Wrench of every patch, (n, P, 6), or (P, 6) for a pose (6,); raises ValueError if a network is missing."""
        self.check_loads([f"{component}_{patch}" for patch in self.patch_names for component in WRENCH_NAMES])
        used = np.ones((len(self.scene.parts), 6), dtype=bool)

        def of_patches(block: Array) -> Array:
            of_parts, _ = self._wrenches(self._part_roots(block, derivative=False), used)
            return np.add.reduceat(of_parts, self.scene.first_parts, axis=1)

        return in_blocks(of_patches, poses)

    def _roots(self, poses: Array, *, derivative: bool) -> tuple[Array, Array]:
        return self._of_patches(self._part_roots(poses, derivative=derivative))

    def _of_patches(self, roots: Mapping[int, _PartRoot]) -> tuple[Array, Array]:
        """Root loads (n, P) and their derivatives of the patches, from those of all parts."""
        s, ds = (np.stack([getattr(root, name) for root in roots.values()], axis=1) for name in ("s", "ds"))
        return patch_roots(s, ds, self._first_roots())

    def _part_roots(self, poses: Array, used: np.ndarray | None = None, *, derivative: bool) -> dict[int, _PartRoot]:
        """Root loads of the parts that are used (parts,), all if left out, by the part's number."""
        return {
            p: self._root(self._local_poses(poses, part, derivative=derivative), part)
            for p, part in enumerate(self.scene.parts)
            if used is None or used[p]
        }

    def _local_poses(self, poses: Array, part: Part, *, derivative: bool) -> LocalPoses:
        """What the networks of a part are evaluated at."""
        anchor, space = part.anchor_mm, self.scene.pose_space
        held, free = space.onto(poses), list(space.free)
        x = local_poses(held, anchor)[:, free]
        if not derivative:
            return LocalPoses(x, np.empty((0, len(free), 6)))
        by_pose = local_pose_jacobian(held, anchor)[:, free]
        return LocalPoses(x, by_pose if space.whole else by_pose @ space.matrix)

    def _network(self, name: str, at: LocalPoses) -> tuple[Array, Array]:
        """Value (n,) and derivative with respect to the pose (n, 6), (0, 6) if not asked for; (n, m) and (n, m, 6) of
        a network of m outputs."""
        network = self.networks[name]
        if len(at.by_pose) < len(at.x):
            return network.value(at.x), np.empty((0, 6))
        value, gradient = network.value_and_gradient(at.x)
        return value, np.einsum("n...i,nij->n...j", gradient, at.by_pose)

    def _root(self, at: LocalPoses, part: Part) -> _PartRoot:
        return _PartRoot(at, *self._network(root_name(part.name), at))

    def _ratios(self, at: LocalPoses, part: Part, components: Sequence[str]) -> dict[str, tuple[Array, Array]]:
        """Ratios (n,) of a part by wrench component, with their derivatives as for `_network`."""
        if not components:
            return {}
        name = ratios_name(part.name)
        known = ratio_outputs(self.scene)[name]
        values, slopes = self._network(name, at)
        if len(known) == 1:
            return {known[0]: (values, slopes)}
        columns = {k: known.index(k) for k in components}
        return {k: (values[:, m], slopes[:, m] if len(at.by_pose) else slopes) for k, m in columns.items()}

    def _wrenches(self, roots: Mapping[int, _PartRoot], used: np.ndarray) -> tuple[Array, Array]:
        """Wrenches (n, parts, 6) and d/dpose (n, parts, 6, 6), (0, parts, 6, 6) if not asked for, zero where used
        (parts, 6) is False."""
        first = next(iter(roots.values()))
        wrenches = np.zeros((len(first.s), *used.shape))
        jacobian = np.zeros((len(first.ds), *used.shape, 6))
        for p, (at, s, ds) in roots.items():
            contact = np.maximum(s, 0.0)
            normal = self.scene.reference_load * contact**2
            d_normal = 2.0 * self.scene.reference_load * contact[: len(ds), None] * ds
            for component, (ratio, d_ratio) in self._of_normal(at, self.scene.parts[p], used[p]).items():
                wrenches[:, p, component] = normal * ratio
                if len(ds):
                    jacobian[:, p, component] = ratio[:, None] * d_normal + normal[:, None] * d_ratio
        return wrenches, jacobian

    def _of_normal(self, at: LocalPoses, part: Part, used: np.ndarray) -> dict[int, tuple[Array, Array]]:
        """What a newton of a part's normal load brings of each wrench component used (6,): its ratio (n,), ±1 of the
        normal load's own, with d/dpose (n, 6), (0, 6) if not asked for."""
        own = part.normal.component
        components = [k for c, k in enumerate(WRENCH_NAMES) if used[c] and k != own]
        ratios = self._ratios(at, part, components)
        found = {WRENCH_NAMES.index(k): ratios[k] for k in components}
        if own is not None and used[k := WRENCH_NAMES.index(own)]:
            found[k] = np.full(len(at.x), part.normal.sign), np.zeros((len(at.by_pose), 6))
        return found

    def _root_count(self) -> int:
        return len(self.scene.parts)

    def _first_roots(self) -> Sequence[int]:
        return self.scene.first_parts

    def _patch_roots(self, roots: ca.MX) -> ca.MX:
        return patch_root_expressions(roots, self._first_roots())

    def _expressions(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        parts, selection = self.known_parts(loads)
        return patch_expressions(parts, selection, self.scene.reference_load, pose, order, self.scene.pose_space)

    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        parts, selection = self.known_parts(loads)
        if not roots:
            used = np.flatnonzero(selection.any(axis=(0, 2)))
            parts, selection = [parts[p] for p in used], selection[:, used]
            if len(parts) == 2 and self._sides_alike():
                parts, selection = parts[:1], selection[:, :1] + REFLECTION * selection[:, 1:]
        return patch_kernel(parts, selection, self.scene.reference_load, self.scene.pose_space)

    def _sides_alike(self) -> bool:
        """True where the joint stays in its plane of symmetry and one side's networks are reflections of the other's:
        the sides' wrenches are then mirror images in every pose, and one side is enough."""
        scene = self.scene
        if not scene.symmetric or any(REFLECTION[k] < 0.0 for k in scene.pose_space.free):
            return False
        pairs = [(name, of) for name, of in self.twins(scene).items() if name in self.networks or of in self.networks]
        return bool(pairs) and all(
            {name, of} <= set(self.networks)
            and equal_networks(self.networks[name], self.reflection(name, self.networks[of], scene))
            for name, of in pairs
        )

    def known_parts(self, loads: Sequence[str]) -> tuple[list[PatchNetworks], Array]:
        """The parts whose root is known, and what of the loads' selection (L, parts, 6) is theirs."""
        roots = self._root_networks()
        known = [p for p, name in enumerate(roots) if name in self.networks]
        of_parts = [self._part_networks(self.scene.parts[p], self.networks[roots[p]]) for p in known]
        return of_parts, self.scene.part_selection(loads)[:, known]

    def _part_networks(self, part: Part, root: Network) -> PatchNetworks:
        name, normal = ratios_name(part.name), part.normal
        components = ratio_outputs(self.scene).get(name, ())
        ratios = self.networks.get(name)
        return PatchNetworks(part.name, part.anchor_mm, normal.component, root, ratios, components, normal.sign)
