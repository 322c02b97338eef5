"""Root loads of models that know the derivatives of their patches' wrenches and gaps."""

from __future__ import annotations

from abc import ABC, abstractmethod

from casadi_contact.contact.model import signed_roots
from casadi_contact.conventions import Array, load_jacobian, pose_or_poses
from casadi_contact.scenes import Scene


class WrenchRoots(ABC):
    """What such a model's wrenches make of the scene's loads; selection (loads, patches, 6) picks the named ones."""

    scene: Scene
    _selection: Array

    @abstractmethod
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their derivatives by the pose (n, patches, 6, 6)."""

    @abstractmethod
    def _gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""

    @pose_or_poses
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load s of each patch (n, patches) and ds/dpose (n, patches, 6).

        s = √(N/N0) in contact (N: the scene's normal loads), s = -gap_slope·gap out of contact.
        """
        return self._roots(poses, *self.wrench_jacobian(poses))

    @pose_or_poses
    def jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `jacobian` and `root_loads` return, from one evaluation."""
        wrenches, slopes = self.wrench_jacobian(poses)
        return *load_jacobian(self._selection, wrenches, slopes), *self._roots(poses, wrenches, slopes)

    def _roots(self, poses: Array, wrenches: Array, slopes: Array) -> tuple[Array, Array]:
        return signed_roots(self.scene, wrenches, slopes, lambda rows: self._gap_jacobian(poses[rows]))
