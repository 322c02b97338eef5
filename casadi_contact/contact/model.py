"""What a contact model is, and how a user's own callable becomes one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from casadi_contact.conventions import (
    WRENCH_NAMES,
    Array,
    angular_velocity_map,
    as_poses,
    load_selection,
    pose_index,
    rotation,
)
from casadi_contact.scenes import Scene

_NORMAL = WRENCH_NAMES.index("Fy")
_BISECTIONS = 12


class ContactModel(Protocol):
    """Loads on the fixed body as functions of the pose (n, 6); elastic foundations and surrogates alike."""

    scene: Scene
    load_names: tuple[str, ...]
    patch_names: tuple[str, ...]

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, loads) [N, N·mm]."""

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, loads) and their derivatives by the pose (n, loads, 6)."""

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load of each patch (n, patches) and its derivatives (n, patches, 6).

        s = √(N/N0) in contact, with N = -Fy of the patch; s = -c·gap (or a like falling quantity) out of contact.
        """


def root_of_normal(normal: Array, slope: Array, reference_load: float) -> tuple[Array, Array]:
    """s = √(N/N0) and ds = dN/(2·N0·s), for N (...) > 0 and dN (..., 6); zero elsewhere."""
    loaded = normal > 0.0
    s = np.sqrt(np.where(loaded, normal, 0.0) / reference_load)
    return s, np.where(loaded, 1.0 / (2.0 * reference_load * np.where(loaded, s, 1.0)), 0.0)[..., None] * slope


class CallableModel:
    """A user's own ``wrenches(poses) -> (n, patches, 6)`` as a contact model.

    Derivatives are central differences (steps in mm and rad). The user's function knows no gaps, so where a patch
    carries no load its gap is found by moving down the scene's first sensitive pose parameter until the patch
    loads: in steps of approach_mm as far as reach_mm, then by bisection.
    """

    def __init__(
        self,
        scene: Scene,
        wrenches: Callable[[Array], Array],
        *,
        step_mm: float = 1e-4,
        step_rad: float = 1e-5,
        approach_mm: float = 0.25,
        reach_mm: float = 15.0,
    ) -> None:
        self.scene = scene
        self.load_names = scene.load_names
        self.patch_names = scene.patch_names
        self._wrenches = wrenches
        self._steps = np.repeat([step_mm, step_rad], 3)
        self._approach_mm = approach_mm
        self._reach_mm = reach_mm
        self._selection = load_selection(self.load_names, self.patch_names)

    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch (n, patches, 6); raises ValueError if the user's function returns another shape."""
        poses = as_poses(poses)
        wrenches = np.asarray(self._wrenches(poses), dtype=float)
        expected = (len(poses), len(self.patch_names), 6)
        if wrenches.shape != expected:
            raise ValueError(f"the contact model returned wrenches of shape {wrenches.shape}, expected {expected}")
        return wrenches

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, loads)."""
        return np.einsum("lpk,npk->nl", self._selection, self.wrenches(poses))

    def _wrench_slopes(self, poses: Array) -> Array:
        moves = np.vstack([np.diag(self._steps), -np.diag(self._steps)])
        shifted = (poses[:, None, :] + moves).reshape(-1, 6)
        plus, minus = np.split(self.wrenches(shifted).reshape(len(poses), 12, -1, 6), 2, axis=1)
        return np.moveaxis((plus - minus) / (2.0 * self._steps[:, None, None]), 1, -1)

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads and their central-difference derivatives (n, loads, 6)."""
        poses = as_poses(poses)
        return self(poses), np.einsum("lpk,npkj->nlj", self._selection, self._wrench_slopes(poses))

    def gaps(self, poses: Array) -> Array:
        """Travel (n, patches) [mm] until each patch loads: 0 in contact, reach_mm where it does not within reach."""
        poses = as_poses(poses)
        axis = np.eye(6)[pose_index(self.scene.sensitive_pose[0])]
        free = self.wrenches(poses)[..., _NORMAL] >= 0.0
        rows, patches = np.nonzero(free)

        def loaded(which: np.ndarray, travel: Array) -> np.ndarray:
            wrenches = self.wrenches(poses[rows[which]] - travel[:, None] * axis)
            return np.asarray(wrenches[np.arange(len(which)), patches[which], _NORMAL] < 0.0)

        far = np.zeros(len(rows))
        searching = np.arange(len(rows))
        while len(searching):
            far[searching] += self._approach_mm
            on = ~loaded(searching, far[searching]) & (far[searching] < self._reach_mm)
            searching = searching[on]
        near, all_of_them = far - self._approach_mm, np.arange(len(rows))
        for _ in range(_BISECTIONS if len(rows) else 0):
            middle = 0.5 * (near + far)
            touching = loaded(all_of_them, middle)
            near, far = np.where(touching, near, middle), np.where(touching, middle, far)
        gaps = np.zeros(free.shape)
        gaps[free] = far
        return gaps

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root loads: √(N/N0) in contact, -gap_slope·gap (see the class) where a patch carries no load."""
        poses = as_poses(poses)
        normal = -self.wrenches(poses)[..., _NORMAL]
        s, slope = root_of_normal(normal, -self._wrench_slopes(poses)[..., _NORMAL, :], self.scene.reference_load)
        rows = np.flatnonzero((normal <= 0.0).any(axis=1))
        if len(rows):
            free = normal[rows] <= 0.0
            by_travel = np.zeros((*free.shape, 6))
            by_travel[..., pose_index(self.scene.sensitive_pose[0])] = -self.scene.gap_slope
            for p, anchor in enumerate(self.scene.anchors_mm):
                # The gap of a patch closes with the motion of its anchor, so a turn of the body closes it too.
                turn = angular_velocity_map(poses[rows, 3:])
                arm = np.einsum("nij,j->ni", rotation(poses[rows, 3:]), anchor)
                lift = np.cross(np.swapaxes(turn, 1, 2), arm[:, None, :])[..., 1]
                by_travel[:, p, 3:] = -self.scene.gap_slope * lift
            s[rows] = np.where(free, -self.scene.gap_slope * self.gaps(poses[rows]), s[rows])
            slope[rows] = np.where(free[..., None], by_travel, slope[rows])
        return s, slope
