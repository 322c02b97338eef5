"""The patch surrogate, the default (README).

Patch p with local pose x_p has a signed root load s_p(x_p) and ratios ρ_pk(x_p):

    N_p = N0·max(s_p, 0)²,   wrench component along the sensitive load: ±N_p,   every other component k: N_p·ρ_pk

so that loads vanish exactly out of contact and nothing ever pulls. All six components are ratios where the normal
load is the magnitude of the force (`scenes.normal_load`). Networks are named ``root_med``, ``ratio_med_Fx`` and so on.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import WRENCH_NAMES, Array, as_poses, load_selection
from casadi_contact.dataset import Samples
from casadi_contact.network import Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.local_pose import local_pose_jacobian, local_poses
from casadi_contact.surrogate.patch_regressions import patch_regressions
from casadi_contact.transcription.expressions import Expressions
from casadi_contact.transcription.kernel import Kernel, patch_kernel
from casadi_contact.transcription.patch_graph import PatchNetworks, patch_expressions


def root_name(patch: str) -> str:
    """Name of a patch's root load network."""
    return f"root_{patch}"


def ratio_name(patch: str, component: str) -> str:
    """Name of the network of one wrench component of a patch, divided by its normal load."""
    return f"ratio_{patch}_{component}"


def _touched(selection: Array) -> np.ndarray:
    """Wrench components (P, 6) that a selection (L, P, 6) needs."""
    return np.asarray((selection != 0.0).any(axis=0))


class PatchSurrogate(Surrogate):
    """Root load and ratio networks per patch; NumPy evaluation, and CasADi functions from `Surrogate`."""

    structure = "patch"

    @classmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        names = []
        for normal in scene.normal_loads:
            patch = normal.patch
            names += [root_name(patch), *(ratio_name(patch, k) for k in WRENCH_NAMES if k != normal.component)]
        return dict.fromkeys(names, 6)

    @staticmethod
    def regressions(samples: Samples, *, gap_weight: float = 0.02) -> list[Regression]:
        """One regression per network that the scene's loads need; see `patch_regressions` for the formulas."""
        return patch_regressions(samples, gap_weight=gap_weight)

    @classmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        selection = load_selection(loads, scene.patch_names)
        names = []
        for p, normal in enumerate(scene.normal_loads):
            used = [k for c, k in enumerate(WRENCH_NAMES) if selection[:, p, c].any()]
            if used:
                ratios = (ratio_name(normal.patch, k) for k in used if k != normal.component)
                names += [root_name(normal.patch), *ratios]
        return names

    def _root_networks(self) -> list[str]:
        return [root_name(patch) for patch in self.patch_names]

    def __call__(self, poses: ArrayLike, loads: Sequence[str] | None = None) -> Array:
        """Loads (n, L) for poses (n, 6)."""
        selection = load_selection(self.check_loads(loads), self.patch_names)
        wrenches, _ = self._wrenches(as_poses(poses), _touched(selection), derivative=False)
        return np.einsum("lpk,npk->nl", selection, wrenches)

    def jacobian(self, poses: ArrayLike, loads: Sequence[str] | None = None) -> tuple[Array, Array]:
        selection = load_selection(self.check_loads(loads), self.patch_names)
        wrenches, derivative = self._wrenches(as_poses(poses), _touched(selection), derivative=True)
        return np.einsum("lpk,npk->nl", selection, wrenches), np.einsum("lpk,npkj->nlj", selection, derivative)

    def wrenches(self, poses: ArrayLike) -> Array:
        """Wrench of every patch, (n, P, 6); raises ValueError if a network is missing."""
        self.check_loads([f"{component}_{patch}" for patch in self.patch_names for component in WRENCH_NAMES])
        used = np.ones((len(self.patch_names), 6), dtype=bool)
        return self._wrenches(as_poses(poses), used, derivative=False)[0]

    def root_loads(self, poses: ArrayLike) -> tuple[Array, Array]:
        self._check_roots()
        poses = as_poses(poses)
        pairs = [self._root(poses, p, derivative=True) for p in range(len(self.patch_names))]
        return np.stack([s for s, _ in pairs], axis=1), np.stack([ds for _, ds in pairs], axis=1)

    def _root(self, poses: Array, p: int, *, derivative: bool) -> tuple[Array, Array]:
        return self._network(root_name(self.patch_names[p]), poses, p, derivative=derivative)

    def _network(self, name: str, poses: Array, p: int, *, derivative: bool) -> tuple[Array, Array]:
        """Value (n,) and derivative with respect to the pose (n, 6), (0, 6) if not asked for."""
        network, anchor = self.networks[name], self.scene.anchors_mm[p]
        local = local_poses(poses, anchor)
        if not derivative:
            return network.value(local), np.empty((0, 6))
        value, gradient = network.value_and_gradient(local)
        return value, np.einsum("ni,nij->nj", gradient, local_pose_jacobian(poses, anchor))

    def _wrenches(self, poses: Array, used: np.ndarray, *, derivative: bool) -> tuple[Array, Array]:
        """Wrenches (n, P, 6) and d/dpose (n, P, 6, 6), zero where used (P, 6) is False."""
        n, patches = len(poses), len(self.patch_names)
        wrenches, jacobian = np.zeros((n, patches, 6)), np.zeros((n, patches, 6, 6) if derivative else (0, 0, 0, 0))
        for p, pressed in enumerate(self.scene.normal_loads):
            if not used[p].any():
                continue
            s, ds = self._root(poses, p, derivative=derivative)
            contact = np.maximum(s, 0.0)
            normal = self.scene.reference_load * contact**2
            d_normal = 2.0 * self.scene.reference_load * contact[:, None] * ds if derivative else ds
            for k, component in enumerate(WRENCH_NAMES):
                if not used[p, k]:
                    continue
                if component == pressed.component:
                    ratio, d_ratio = np.full(n, pressed.sign), np.zeros_like(ds)
                else:
                    name = ratio_name(pressed.patch, component)
                    ratio, d_ratio = self._network(name, poses, p, derivative=derivative)
                wrenches[:, p, k] = normal * ratio
                if derivative:
                    jacobian[:, p, k] = ratio[:, None] * d_normal + normal[:, None] * d_ratio
        return wrenches, jacobian

    def _expressions(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        patches, selection = self._patches(loads)
        return patch_expressions(patches, selection, self.scene.reference_load, pose, order)

    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        patches, selection = self._patches(loads)
        if not roots:
            used = np.flatnonzero(selection.any(axis=(0, 2)))
            patches, selection = [patches[p] for p in used], selection[:, used]
        return patch_kernel(patches, selection, self.scene.reference_load)

    def _patches(self, loads: Sequence[str]) -> tuple[list[PatchNetworks], Array]:
        """The patches whose root is known, and the part of the loads' selection (L, patches, 6) that is theirs."""
        present = [p for p, patch in enumerate(self.patch_names) if root_name(patch) in self.networks]
        patches = []
        for p in present:
            patch = self.patch_names[p]
            ratios = {
                k: self.networks[ratio_name(patch, k)] for k in WRENCH_NAMES if ratio_name(patch, k) in self.networks
            }
            root = self.networks[root_name(patch)]
            normal = self.scene.normal_loads[p]
            patches.append(
                PatchNetworks(patch, self.scene.anchors_mm[p], normal.component, root, ratios, sign=normal.sign)
            )
        return patches, load_selection(loads, self.patch_names)[:, present]
