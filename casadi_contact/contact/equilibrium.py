"""The equations of a static analysis: free pose parameters, target loads, and how far off these are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel, with_loads
from casadi_contact.core.conventions import LEVER_MM, Array, as_poses, pose_index
from casadi_contact.scenes.pose_space import PoseSpace


@dataclass(frozen=True)
class Equilibrium:
    """Wanted loads (n, targets) of a contact model, to be met by varying the free pose parameters.

    A patch's normal load that is one load is compared as a signed root load, r = s - √(N*/N0), which is nearly
    linear in the pose and keeps its slope out of contact. Where it is the magnitude of three target forces these are
    compared as a root vector likewise: r = s·u - √(N*/N0)·u*, with u the direction of the force (out of contact, that
    in which the body closes the gap). The total of normal loads along one direction likewise, with the root
    S = √(Σ max(s, 0)²) of all patches, out of contact that of the nearest. Any other load as r = (load - target)/N0
    (torques over N0·LEVER_MM).
    """

    model: ContactModel
    free: tuple[int, ...]
    names: tuple[str, ...]
    target: Array

    @classmethod
    def of(cls, model: ContactModel, count: int, free: Sequence[str], targets: Mapping[str, ArrayLike]) -> Equilibrium:
        """Check names and shapes; raises ValueError for unknown or repeated names, for free ones that the scene locks
        or ties, and for targets not finite."""
        if not free or len(set(free)) != len(free):
            raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
        model.scene.pose_space.check_free(free)
        if not targets:
            raise ValueError("targets is empty, expected target loads by name, for example {'Fy_med': -700.0}")
        model = with_loads(model, tuple(targets))
        target = np.empty((count, len(targets)))
        for column, (name, value) in enumerate(targets.items()):
            array = np.asarray(value, dtype=float)
            if array.shape not in ((), (1,), (count,)):
                raise ValueError(f"target {name} has shape {array.shape}, expected a number or ({count},)")
            if not np.isfinite(array).all():
                raise ValueError(f"target {name} holds NaN or infinity, expected finite loads")
            target[:, column] = array
        return cls(model, tuple(pose_index(name) for name in free), tuple(targets), target)

    @property
    def _directed_targets(self) -> dict[int, int]:
        """Patch of each target (by column) that is its normal load."""
        normals = self.model.scene.normal_loads
        patches = {load.loads[0]: p for p, load in enumerate(normals) if load.component is not None}
        return {column: patches[name] for column, name in enumerate(self.names) if name in patches}

    @property
    def _total_targets(self) -> list[int]:
        """Columns of targets that are the total of all patches' normal loads along one direction."""
        normals = self.model.scene.normal_loads
        component = normals[0].component
        if len({(normal.component, normal.sign) for normal in normals}) > 1 or component not in self.names:
            return []
        column = self.names.index(component)
        return [] if column in self._directed_targets else [column]

    @property
    def _vector_targets(self) -> dict[int, list[int]]:
        """Columns of the three targets whose magnitude is a patch's normal load, by patch."""
        normals = self.model.scene.normal_loads
        return {
            p: [self.names.index(name) for name in load.loads]
            for p, load in enumerate(normals)
            if load.component is None and set(load.loads) <= set(self.names)
        }

    def pressing(self) -> Equilibrium | None:
        """The equations of the sensitive pose parameters under the normal loads alone; None where that are not some of
        the free parameters, with a load for each."""
        sensitive = tuple(pose_index(name) for name in self.model.scene.sensitive_pose)
        of_vectors = [column for columns in self._vector_targets.values() for column in columns]
        columns = sorted({*self._directed_targets, *self._total_targets, *of_vectors})
        if not columns or len(columns) != len(sensitive) or not set(sensitive) < set(self.free):
            return None
        return Equilibrium(self.model, sensitive, tuple(self.names[k] for k in columns), self.target[:, columns])

    def of_rows(self, rows: np.ndarray) -> Equilibrium:
        """The equations of these poses alone."""
        return Equilibrium(self.model, self.free, self.names, self.target[rows])

    def misses_a_force(self, misfit: Array, share: float = 0.01) -> np.ndarray:
        """True (n,) where the body can be moved freely and carries less than a share of a target force that has no
        direction of its own; False for all others."""
        missing = np.zeros(len(misfit), dtype=bool)
        if {0, 1, 2} <= set(self.free):
            for columns in self._vector_targets.values():
                force = self.target[:, columns]
                carried = np.linalg.norm(misfit[:, columns] + force, axis=1)
                missing |= carried < share * np.linalg.norm(force, axis=1)
        return missing

    def along_the_force(self, poses: Array, ways_mm: Array, number: int) -> Array:
        """Poses (n, 6) moved along the force that a patch shall carry, by the way about which residuals are
        least (number 0), next to least (1), ...: there are several where the body passes a rim before it presses."""
        columns = next(iter(self._vector_targets.values()))
        force = self.target[:, columns]
        along = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
        moved = np.repeat(poses[:, None], len(ways_mm), axis=1)
        moved[:, :, :3] += ways_mm[:, None] * along[:, None]
        moved = self._space.project(moved)
        rows = np.repeat(np.arange(len(poses)), len(ways_mm))
        left = np.linalg.norm(self.residuals(moved.reshape(-1, 6), rows)[0], axis=1).reshape(moved.shape[:2])
        beside = np.pad(left, ((0, 0), (1, 1)), constant_values=np.inf)
        least = (left <= beside[:, :-2]) & (left <= beside[:, 2:])
        order = np.argsort(np.where(least, left, np.inf), axis=1, kind="stable")
        return np.asarray(moved[np.arange(len(poses)), order[:, number]])

    def pulls(self) -> np.ndarray:
        """True (n,) where a target normal load would pull, which no contact can."""
        normals = self.model.scene.normal_loads
        patches = self._directed_targets | dict.fromkeys(self._total_targets, 0)
        pulling = [normals[p].sign * self.target[:, column] < 0.0 for column, p in patches.items()]
        return np.any(pulling, axis=0) if pulling else np.zeros(len(self.target), dtype=bool)

    def misfit(self, loads: Array, rows: np.ndarray) -> Array:
        """Named loads minus target loads (rows, targets) [N, N·mm]."""
        columns = [self.model.load_names.index(name) for name in self.names]
        return loads[:, columns] - self.target[rows]

    def each_in_newtons(self, misfit: Array) -> Array:
        """Sizes (..., targets) [N] of misfits, torques over LEVER_MM."""
        return np.abs(misfit / self.load_scales)

    def in_newtons(self, misfit: Array) -> Array:
        """Largest misfit of each row (rows,) [N], torques over LEVER_MM."""
        return self.each_in_newtons(misfit).max(axis=1)

    def residuals(self, poses: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        """r (rows, targets), dr/dfree (rows, targets, free) in comparable mm, and the misfit [N, N·mm]; NaN all three
        where the model gives no finite loads, or none within a difference's step of them."""
        model, n0 = self.model, self.model.scene.reference_load
        directed, vectors, totals = self._directed_targets, self._vector_targets, self._total_targets
        if directed or vectors or totals:
            loads, jacobian, *roots = model.jacobian_and_roots(poses)
        else:
            loads, jacobian = model.jacobian(poses)
        misfit = self.misfit(loads, rows)
        r, gradient = np.empty_like(misfit), np.empty((*misfit.shape, 6))
        for column, (name, scale) in enumerate(zip(self.names, n0 * self.load_scales, strict=True)):
            r[:, column] = misfit[:, column] / scale
            gradient[:, column] = jacobian[:, model.load_names.index(name)] / scale
        for column in totals:
            target = model.scene.normal_loads[0].sign * self.target[rows, column]
            total, gradient[:, column] = _total_root(*roots)
            r[:, column] = total - np.sqrt(np.maximum(target, 0.0) / n0)
        for column, patch in directed.items():
            target = model.scene.normal_loads[patch].sign * self.target[rows, column]
            r[:, column] = roots[0][:, patch] - np.sqrt(np.maximum(target, 0.0) / n0)
            gradient[:, column] = roots[1][:, patch]
        for patch, columns in vectors.items():
            of_loads = [model.load_names.index(self.names[column]) for column in columns]
            target = self.target[rows][:, columns]
            size = np.linalg.norm(target, axis=1, keepdims=True)
            vector, gradient[:, columns] = _root_vector(
                loads[:, of_loads], jacobian[:, of_loads], roots[0][:, patch], roots[1][:, patch], n0
            )
            r[:, columns] = vector - target / np.sqrt(n0 * np.where(size > 0.0, size, 1.0))
        gradient = self._space.pull_back(gradient)[..., list(self.free)] * self.free_scales
        lost = ~np.isfinite(gradient).all(axis=(1, 2)) | ~np.isfinite(r).all(axis=1)
        r[lost], gradient[lost], misfit[lost] = np.nan, np.nan, np.nan
        return r, gradient, misfit

    def moved(self, poses: Array, steps: Array) -> Array:
        """Poses (n, 6) after comparable steps (n, free) of the free parameters, what is tied to them following."""
        moved = poses.copy()
        moved[:, list(self.free)] += steps * self.free_scales
        return self._space.project(moved)

    @property
    def _space(self) -> PoseSpace:
        return self.model.scene.pose_space

    @property
    def load_scales(self) -> Array:
        """What target loads are divided by to be compared in N: 1 for a force, LEVER_MM for a torque."""
        return np.array([LEVER_MM if name.startswith("T") else 1.0 for name in self.names])

    @property
    def free_scales(self) -> Array:
        """Size of one comparable step of each free parameter: 1 mm, or 1/LEVER_MM rad."""
        return np.array([1.0 if i < 3 else 1.0 / LEVER_MM for i in self.free])


def _total_root(s: Array, ds: Array) -> tuple[Array, Array]:
    """√(Σ max(s, 0)²) (n,) of root loads (n, P) and its derivatives (n, 6); where no patch is in contact, those of the
    nearest."""
    inside, rows = np.maximum(s, 0.0), np.arange(len(s))
    total, nearest = np.linalg.norm(inside, axis=1), s.argmax(axis=1)
    loaded = total > 0.0
    shares = inside / np.where(loaded, total, 1.0)[:, None]
    value = np.where(loaded, total, s[rows, nearest])
    return value, np.where(loaded[:, None], np.einsum("np,npj->nj", shares, ds), ds[rows, nearest])


def _root_vector(force: Array, gradient: Array, s: Array, ds: Array, n0: float) -> tuple[Array, Array]:
    """s·u (n, 3) and its derivatives (n, 3, 6): F/√(N·N0) in contact; out of contact along the gap's gradient.

    There the turning of u is left out of the derivative: a step closes the gap first.
    """
    size = np.linalg.norm(force, axis=1)
    loaded = size > 0.0
    root = np.sqrt(np.where(loaded, size, 1.0) * n0)[:, None]
    along = force / np.where(loaded, size, 1.0)[:, None]
    in_contact = (gradient - 0.5 * np.einsum("ni,nk,nkj->nij", along, along, gradient)) / root[..., None]
    closing = ds[:, :3] / np.maximum(np.linalg.norm(ds[:, :3], axis=1, keepdims=True), 1e-300)
    vector = np.where(loaded[:, None], force / root, s[:, None] * closing)
    return vector, np.where(loaded[:, None, None], in_contact, closing[..., None] * ds[:, None, :])


def start_copy(model: ContactModel, poses: ArrayLike) -> Array:
    """A writable copy of checked poses, with what the model's scene locks or ties put in place."""
    return model.scene.pose_space.project(as_poses(poses).copy())
