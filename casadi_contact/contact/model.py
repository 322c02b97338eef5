"""What a contact model is, its root loads, and the same model by other named loads."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from casadi_contact.core.conventions import Array, batched, check_loads, load_jacobian, load_selection, possible_loads
from casadi_contact.scenes.normal_load import normal_forces, normal_gradients
from casadi_contact.scenes.scene import Scene


class ContactModel(Protocol):
    """Loads on the fixed body as functions of the pose (n, 6): elastic foundations and surrogates alike.

    Whoever inherits from it writes `__call__`, `jacobian` and `root_loads`, and where the model has them the rest, with
    has_wrenches and has_gaps telling so. A model with wrenches settles under any load of its patches, another one under
    those of load_names alone. A function of poses that gives wrenches becomes such a model by `CallableModel`.
    """

    scene: Scene
    load_names: tuple[str, ...]
    patch_names: tuple[str, ...]
    has_wrenches: bool = False
    has_gaps: bool = False

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, loads) [N, N·mm]."""

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, loads) and their derivatives by the pose (n, loads, 6)."""

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load of each patch (n, patches) and its derivatives (n, patches, 6).

        s = √(N/N0) in contact, with N the patch's normal load; out of contact s = -c·gap, or what falls alike.
        """

    def jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `jacobian` and `root_loads` return."""
        return *self.jacobian(poses), *self.root_loads(poses)

    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm]."""
        raise self._lacking("wrenches")

    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their derivatives by the pose (n, patches, 6, 6)."""
        raise self._lacking("wrenches")

    def gaps(self, poses: Array) -> Array:
        """Distance of each patch (n, patches) [mm] from the moving body; below zero where they overlap."""
        raise self._lacking("gaps")

    def _lacking(self, what: str) -> NotImplementedError:
        return NotImplementedError(f"{self!r} has no {what}")

    def at_edge(self, poses: Array) -> np.ndarray:
        """True (n, patches) where contact reaches a patch's rim, part of it may lie beyond; False where unknown."""
        return np.zeros((len(poses), len(self.patch_names)), dtype=bool)


class NamedLoads(ContactModel):
    """A contact model by other named loads than its scene's, made of its patches' wrenches."""

    def __init__(self, model: ContactModel, load_names: Sequence[str]) -> None:
        self.scene, self.patch_names, self.load_names = model.scene, model.patch_names, tuple(load_names)
        self._model, self._selection = model, load_selection(load_names, model.patch_names)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L) [N, N·mm]."""
        return np.einsum("lpk,npk->nl", self._selection, self._model.wrenches(poses))

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, L) and their derivatives by the pose (n, L, 6)."""
        return load_jacobian(self._selection, *self._model.wrench_jacobian(poses))

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Those of the model: (n, patches), (n, patches, 6)."""
        return self._model.root_loads(poses)


def with_loads(model: ContactModel, names: Sequence[str]) -> ContactModel:
    """The model, or where it does not give all of these loads, `NamedLoads` of it.

    Raises ValueError for a load that no patch has, or that a model without wrenches does not give.
    """
    possible = possible_loads(model.patch_names) if model.has_wrenches else model.load_names
    for name in names:
        if name not in model.load_names and name not in possible:
            raise ValueError(f"unknown target {name!r}, expected one of {', '.join(possible)}")
    return model if set(names) <= set(model.load_names) else NamedLoads(model, names)


def root_of_normal(normal: Array, gradient: Array, reference_load: float) -> tuple[Array, Array]:
    """s = √(N/N0) and ds = dN/(2·N0·s), for N (...) > 0 and dN (..., 6); zero elsewhere."""
    loaded = normal > 0.0
    s = np.sqrt(np.where(loaded, normal, 0.0) / reference_load)
    return s, np.where(loaded, 1.0 / (2.0 * reference_load * np.where(loaded, s, 1.0)), 0.0)[..., None] * gradient


def total_root(s: Array, ds: Array) -> tuple[Array, Array]:
    """√(Σ max(s, 0)²) (n,) of root loads (n, P) and its derivatives (n, 6); out of contact, those of the nearest."""
    inside, rows = np.maximum(s, 0.0), np.arange(len(s))
    total, nearest = np.linalg.norm(inside, axis=1), s.argmax(axis=1)
    loaded = total > 0.0
    shares = inside / np.where(loaded, total, 1.0)[:, None]
    value = np.where(loaded, total, s[rows, nearest])
    return value, np.where(loaded[:, None], np.einsum("np,npj->nj", shares, ds), ds[rows, nearest])


def root_vector(force: Array, gradient: Array, s: Array, ds: Array, n0: float) -> tuple[Array, Array]:
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


def signed_roots(
    scene: Scene, wrenches: Array, jacobian: Array, gaps: Callable[[np.ndarray], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Signed root loads (n, patches) and ds/dpose (n, patches, 6) from wrenches and their derivatives by the pose.

    gaps(rows): gaps and their derivatives at those poses, asked for where some patch carries no load.
    """
    normal = normal_forces(scene.normal_loads, wrenches)
    s, gradient = root_of_normal(normal, normal_gradients(scene.normal_loads, wrenches, jacobian), scene.reference_load)
    rows = np.flatnonzero((normal <= 0.0).any(axis=1))
    if len(rows):
        free = normal[rows] <= 0.0
        distance, by_pose = gaps(rows)
        s[rows] = np.where(free, -scene.gap_slope * distance, s[rows])
        gradient[rows] = np.where(free[..., None], -scene.gap_slope * by_pose, gradient[rows])
    return s, gradient


def overlaps_without_load(wrenches: Array, gaps: Array, allowed_mm: float = 0.1) -> np.ndarray:
    """True (n, patches) where gaps (n, patches) [mm] have the wrong sign: more overlap than is allowed at a wrench
    (n, patches, 6) of exactly zero. Cells of a mesh miss overlaps of 0.08 mm that its triangles see."""
    return (wrenches == 0.0).all(axis=2) & (gaps < -allowed_mm)


@dataclass(frozen=True)
class PatchLoads:
    """One patch in n poses: wrench (n, 6) and gap (n,), with their derivatives by the twist of the moving body about t
    (n, 6, 6), (n, 6); cut (n,): contact reaches the rim. For one pose without the first axis.
    """

    wrench: Array
    stiffness: Array
    gap: Array
    gap_gradient: Array
    cut: np.ndarray


class WrenchLoads(ContactModel):
    """What a model's wrenches make of the scene's loads; selection (loads, patches, 6) picks the named ones."""

    has_wrenches = has_gaps = True

    def __init__(self, scene: Scene) -> None:
        if not isinstance(scene, Scene):
            raise TypeError(f"got {scene!r}, expected a scene, as cc.load_scene gives it for a name or a file")
        self.scene, self.load_names, self.patch_names = scene, scene.load_names, scene.patch_names
        self._selection = load_selection(self.load_names, self.patch_names)

    @abstractmethod
    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""

    @batched
    def gaps(self, poses: Array) -> Array:
        """Distance of each patch (n, patches) [mm] from the moving body; below zero, minus the largest overlap."""
        return self.gap_jacobian(poses)[0]

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all of ``load_names``); ValueError where one is not the scene's."""
        return check_loads(self.load_names, loads)

    @batched
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all in the order of ``load_names``, or those asked for.

        Raises ValueError for one that is not the scene's.
        """
        return np.einsum("lpk,npk->nl", self._rows(loads), self.wrenches(poses))

    @batched
    def jacobian(self, poses: Array, loads: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Named loads (n, loads), and their derivatives by the pose (n, loads, 6) [per mm, per rad]."""
        return load_jacobian(self._rows(loads), *self.wrench_jacobian(poses))

    @batched
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load s of each patch (n, patches) and ds/dpose (n, patches, 6).

        s = √(N/N0) in contact (N: the scene's normal loads), s = -gap_slope·gap out of contact.
        """
        return self._wrenches_and_roots(poses)[2:]

    @batched
    def jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `jacobian` and `root_loads` return, from one evaluation."""
        wrenches, jacobian, roots, root_jacobian = self._wrenches_and_roots(poses)
        return *load_jacobian(self._selection, wrenches, jacobian), roots, root_jacobian

    def _rows(self, loads: Iterable[str] | None) -> Array:
        """Rows (loads, patches, 6) of the selection that picks named loads from wrenches."""
        return self._selection[[self.load_names.index(name) for name in self.check_loads(loads)]]

    def _wrenches_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `wrench_jacobian` and `root_loads` return."""
        wrenches, jacobian = self.wrench_jacobian(poses)
        roots = signed_roots(self.scene, wrenches, jacobian, lambda rows: self.gap_jacobian(poses[rows]))
        return wrenches, jacobian, *roots
