"""Named loads and root loads of models that know their patches' wrenches and gaps with derivatives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

import numpy as np

from casadi_contact.contact.model import ContactModel, signed_roots
from casadi_contact.core.conventions import Array, check_loads, load_jacobian, pose_or_poses


class WrenchLoads(ContactModel):
    """What such a model's wrenches make of the scene's loads; selection (loads, patches, 6) picks the named ones."""

    _selection: Array
    has_wrenches = has_gaps = True

    @abstractmethod
    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm], for poses (n, 6)."""

    @abstractmethod
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their derivatives by the pose (n, patches, 6, 6)."""

    @abstractmethod
    def _gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all of ``load_names``); ValueError where one is not the scene's."""
        return check_loads(self.load_names, loads)

    @pose_or_poses
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all in the order of ``load_names``, or those asked for.

        Raises ValueError for one that is not the scene's.
        """
        return np.einsum("lpk,npk->nl", self._rows(loads), self.wrenches(poses))

    @pose_or_poses
    def jacobian(self, poses: Array, loads: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Named loads (n, loads), as a call gives them, and their derivatives by the pose (n, loads, 6) [per mm, per
        rad]."""
        return load_jacobian(self._rows(loads), *self.wrench_jacobian(poses))

    @pose_or_poses
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load s of each patch (n, patches) and ds/dpose (n, patches, 6).

        s = √(N/N0) in contact (N: the scene's normal loads), s = -gap_slope·gap out of contact.
        """
        return self._wrenches_and_roots(poses)[2:]

    @pose_or_poses
    def jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `jacobian` and `root_loads` return, from one evaluation."""
        wrenches, slopes, roots, root_slopes = self._wrenches_and_roots(poses)
        return *load_jacobian(self._selection, wrenches, slopes), roots, root_slopes

    def _rows(self, loads: Iterable[str] | None) -> Array:
        """Rows (loads, patches, 6) of the selection that picks named loads from wrenches."""
        return self._selection[[self.load_names.index(name) for name in self.check_loads(loads)]]

    def _wrenches_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `wrench_jacobian` and `root_loads` return."""
        wrenches, slopes = self.wrench_jacobian(poses)
        roots = signed_roots(self.scene, wrenches, slopes, lambda rows: self._gap_jacobian(poses[rows]))
        return wrenches, slopes, *roots
