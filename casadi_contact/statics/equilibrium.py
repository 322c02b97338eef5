"""The equations of a static analysis: which pose parameters are free, which loads are wanted, how far off they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array, as_poses, is_force, pose_index

LEVER_MM = 25.0  # turns N·mm into comparable N, and rad into comparable mm


@dataclass(frozen=True)
class Equilibrium:
    """Wanted loads (n, targets) of a contact model, to be met by varying the free pose parameters.

    The load of a patch's sensitive direction is compared as a signed root load, r = s - √(N*/N0), which is nearly
    linear in the pose and keeps its slope out of contact; any other load as r = (load - wanted)/N0 (torques over
    N0·LEVER_MM).
    """

    model: ContactModel
    free: tuple[int, ...]
    names: tuple[str, ...]
    wanted: Array

    @classmethod
    def of(cls, model: ContactModel, count: int, free: Sequence[str], targets: Mapping[str, ArrayLike]) -> Equilibrium:
        """Check names and shapes; raises ValueError for unknown or repeated names and for targets not finite."""
        if not free or len(set(free)) != len(free):
            raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
        if not targets:
            raise ValueError("targets is empty, expected wanted loads by name, for example {'Fy_med': -700.0}")
        wanted = np.empty((count, len(targets)))
        for column, (name, value) in enumerate(targets.items()):
            if name not in model.load_names:
                raise ValueError(f"unknown target {name!r}, expected one of {', '.join(model.load_names)}")
            array = np.asarray(value, dtype=float)
            if array.shape not in ((), (1,), (count,)):
                raise ValueError(f"target {name} has shape {array.shape}, expected a number or ({count},)")
            if not np.isfinite(array).all():
                raise ValueError(f"target {name} holds NaN or infinity, expected finite loads")
            wanted[:, column] = array
        return cls(model, tuple(pose_index(name) for name in free), tuple(targets), wanted)

    @property
    def _patch_of(self) -> list[int | None]:
        sensitive = self.model.scene.sensitive_loads
        per_patch = len(sensitive) == len(self.model.patch_names)
        return [sensitive.index(name) if per_patch and name in sensitive else None for name in self.names]

    def pulls(self) -> np.ndarray:
        """True (n,) where a wanted load of a patch's sensitive direction would pull, which no contact can."""
        columns = [column for column, patch in enumerate(self._patch_of) if patch is not None]
        return np.asarray((self.wanted[:, columns] > 0.0).any(axis=1))

    def misfit(self, loads: Array, rows: np.ndarray) -> Array:
        """Named loads minus wanted loads (rows, targets) [N, N·mm]."""
        columns = [self.model.load_names.index(name) for name in self.names]
        return loads[:, columns] - self.wanted[rows]

    def in_newtons(self, misfit: Array) -> Array:
        """Largest misfit of each row (rows,) [N], torques over LEVER_MM."""
        scale = np.array([1.0 if is_force(name) else LEVER_MM for name in self.names])
        return np.abs(misfit / scale).max(axis=1)

    def residuals(self, poses: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        """r (rows, targets), dr/dfree (rows, targets, free) in comparable mm, and the misfit [N, N·mm]."""
        model, n0 = self.model, self.model.scene.reference_load
        loads, jacobian = model.jacobian(poses)
        misfit = self.misfit(loads, rows)
        r, slope = np.empty_like(misfit), np.empty((*misfit.shape, 6))
        roots = model.root_loads(poses) if any(p is not None for p in self._patch_of) else None
        for column, (name, patch) in enumerate(zip(self.names, self._patch_of, strict=True)):
            if patch is not None and roots is not None:
                r[:, column] = roots[0][:, patch] - np.sqrt(np.maximum(-self.wanted[rows, column], 0.0) / n0)
                slope[:, column] = roots[1][:, patch]
            else:
                scale = n0 if is_force(name) else n0 * LEVER_MM
                r[:, column] = misfit[:, column] / scale
                slope[:, column] = jacobian[:, model.load_names.index(name)] / scale
        return r, slope[..., list(self.free)] * self.free_scales, misfit

    @property
    def free_scales(self) -> Array:
        """Size of one comparable step of each free parameter: 1 mm, or 1/LEVER_MM rad."""
        return np.array([1.0 if i < 3 else 1.0 / LEVER_MM for i in self.free])


def checked_start(poses: ArrayLike) -> Array:
    """A writable copy of checked poses."""
    return as_poses(poses).copy()
