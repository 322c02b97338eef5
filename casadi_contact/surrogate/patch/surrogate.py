"""The patch surrogate (docs/method.md).

Patch p with local pose x_p has a signed root load s_p(x_p) and ratios ρ_pk(x_p):

    N_p = N0·max(s_p, 0)²,   wrench component along the sensitive load: ±N_p,   every other component k: N_p·ρ_pk

so that loads vanish exactly out of contact and nothing ever pulls. All six components are ratios where the normal
load is the magnitude of the force (`scenes.normal_load`). Networks are named ``root_med`` and ``ratios_med``; the
second gives all ratios of a patch that the scene's loads need, from shared hidden neurons.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import (
    WRENCH_NAMES,
    Array,
    angular_velocity_map,
    batched,
    local_poses,
    rotation,
    wrench_names,
)
from casadi_contact.networks.kernel.source import Kernel
from casadi_contact.networks.network import Network, Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate, map_in_chunks
from casadi_contact.surrogate.patch.formulas import patch_expressions, patch_kernel
from casadi_contact.surrogate.patch.networks import patch_networks, ratio_outputs, ratios_name, reflected, root_name

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples


class PatchSurrogate(Surrogate):
    """A network of the root load and one of all ratios per patch."""

    structure = "patch"
    title = "patch surrogate"
    budget_shares: ClassVar[Mapping[str, float]] = {"ratios": 0.2}  # smoother than a root load, and sooner good enough

    def __init__(self, scene: Scene, networks: Mapping[str, Network], *rest: Any, **options: Any) -> None:
        super().__init__(scene, networks, *rest, **options)
        self.patches = patch_networks(scene, self.networks)
        self._space = None if scene.pose_space.unconstrained else scene.pose_space
        self._selections = {names: scene.selection(names) for names in (self.load_names, ())}

    @classmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """Root loads of every patch, and ratios that loads need; inputs are the free columns of the local pose."""
        names = [*(root_name(patch.name) for patch in scene.patches), *ratio_outputs(scene)]
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
        """Networks of a symmetric joint's second patch: mirror images of the first's, where it needs the same."""
        if not scene.symmetric:
            return {}
        first, second = (patch.name for patch in scene.patches)
        of_first, of_second = (ratio_outputs(scene).get(ratios_name(patch)) for patch in (first, second))
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
        """Of every patch that the loads need: its root load, and its ratios where a load is made of one."""
        selection = scene.selection(loads)
        names = []
        for p, patch in enumerate(scene.patches):
            used = [k for c, k in enumerate(WRENCH_NAMES) if selection[:, p, c].any()]
            if used:
                names.append(root_name(patch.name))
            if any(k != patch.normal.component for k in used):
                names.append(ratios_name(patch.name))
        return names

    def _selection(self, loads: Iterable[str]) -> Array:
        """`Scene.selection` (L, patches, 6), kept for the next call."""
        if (names := tuple(loads)) not in self._selections:
            self._selections[names] = self.scene.selection(names)
        return self._selections[names]

    def _loads(self, poses: Array, loads: Sequence[str], *, derivative: bool) -> tuple[Array, Array]:
        needed = np.flatnonzero(self._selection(loads).any(axis=(0, 2))).tolist()
        return self._of_patches(poses, loads, needed, derivative=derivative)[:2]

    def _roots(self, poses: Array, *, derivative: bool) -> tuple[Array, Array]:
        return self._of_patches(poses, (), range(len(self.patches)), derivative=derivative)[2:]

    def _jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        return self._of_patches(poses, self.load_names, range(len(self.patches)), derivative=True)

    def _of_patches(
        self, poses: Array, loads: Sequence[str], patches: Sequence[int], *, derivative: bool
    ) -> tuple[Array, Array, Array, Array]:
        """Loads (n, L) of these patches, by the pose (n, L, 6); their root loads (n, patches), by the pose."""
        selection, m = self._selection(loads), len(poses) * derivative
        values, jacobian = np.zeros((len(poses), len(loads))), np.zeros((m, len(loads), 6))
        roots, d_roots = np.empty((len(poses), len(patches))), np.empty((m, len(patches), 6))
        for k, p in enumerate(patches):
            used = np.asarray(selection[:, p].any(axis=0))
            roots[:, k], d_roots[:, k], wrench, d_wrench = self._part(poses, p, used, derivative=derivative)
            values += wrench @ selection[:, p].T
            jacobian += selection[:, p] @ d_wrench
        return values, jacobian, roots, d_roots

    @batched
    def wrenches(self, poses: Array) -> Array:
        """Wrench of every patch, (n, P, 6), or (P, 6) for a pose (6,); ValueError where not all was learned."""
        for patch in self.patches:
            unknown = [k for c, k in enumerate(WRENCH_NAMES) if c not in patch.columns and not patch.own[c]]
            if unknown:
                raise ValueError(f"{', '.join(unknown)} of {patch.name} not learned, expected loads of it in the scene")
        names = wrench_names(self.patch_names)
        shape = (len(self.patch_names), 6)
        return map_in_chunks(lambda some: self._loads(some, names, derivative=False)[0].reshape(-1, *shape), poses)

    def _part(self, poses: Array, p: int, used: np.ndarray, *, derivative: bool) -> tuple[Array, Array, Array, Array]:
        """Root load s (n,) of patch p and its wrench W (n, 6), as s, ds/dpose (n, 6), W, dW/dpose (n, 6, 6).

        used (6,): the wrench components that are needed. Derivatives are (0, 6) and (0, 6, 6) if not asked for.
        """
        patch, space, n0 = self.patches[p], self._space, self.scene.reference_load
        on_space = poses if space is None else space.project(poses)
        x, by_pose = local_poses(on_space, patch.anchor_mm), np.empty((0, 6, 6))
        if derivative:
            by_pose = local_pose_jacobian(on_space, patch.anchor_mm)
            by_pose = by_pose if space is None else space.pull_back(by_pose)
        s, ds = _in_pose(patch.root, x, by_pose)
        ratios, d_ratios = np.tile(patch.own, (len(x), 1)), np.zeros((len(by_pose), 6, 6))
        if used[patch.own == 0.0].any():
            values, gradients = _in_pose(patch.ratios, x, by_pose)
            ratios[:, patch.columns] = values.reshape(len(x), len(patch.columns))
            d_ratios[:, patch.columns] = gradients.reshape(len(by_pose), len(patch.columns), 6)
        contact = np.maximum(s, 0.0)
        normal, d_normal = n0 * contact**2, 2.0 * n0 * contact[: len(ds), None] * ds
        d_wrench = ratios[: len(ds), :, None] * d_normal[:, None] + normal[: len(ds), None, None] * d_ratios
        return s, ds, normal[:, None] * ratios, d_wrench

    def _expressions(self, pose: ca.MX, loads: Sequence[str]) -> tuple[ca.MX, ca.MX]:
        scene = self.scene
        return patch_expressions(self.patches, self._selection(loads), scene.reference_load, scene.pose_space, pose)

    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        selection = self._selection(loads)
        known = np.flatnonzero(selection.any(axis=(0, 2)) | roots).tolist()
        patches = [self.patches[p] for p in known]
        return patch_kernel(patches, selection[:, known], self.scene.reference_load, self._space)


def local_pose_jacobian(poses: Array, anchor_mm: Array) -> Array:
    """dx/dpose of shape (n, 6, 6) = [[I, B], [0, I]] with columns B_i = e_i × (R a), e_i the axes of rotation."""
    jacobian = np.broadcast_to(np.eye(6), (len(poses), 6, 6)).copy()
    arm = rotation(poses[:, 3:]) @ anchor_mm
    jacobian[:, :3, 3:] = np.cross(angular_velocity_map(poses[:, 3:]), arm[:, :, None], axis=1)
    return jacobian


def _in_pose(network: Network, x: Array, by_pose: Array) -> tuple[Array, Array]:
    """Value (n,) of a network at local poses x (n, 6) and its derivative by the pose (n, 6), (n, m) and (n, m, 6) for m
    outputs; no rows of derivatives where by_pose (n, 6, 6) has none."""
    if len(by_pose) < len(x):
        return network.value(x), np.empty((0, 6))
    value, gradient = network.value_and_gradient(x)
    return value, np.einsum("n...i,nij->n...j", gradient, by_pose)
