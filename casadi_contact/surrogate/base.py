"""A surrogate: named networks, CasADi functions, file and description, whatever its structure."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.friction import checked_velocities
from casadi_contact.core.conventions import POSE_NAMES, Array, batched, check_loads, pose_index
from casadi_contact.core.threads import thread_count
from casadi_contact.networks.functions import as_weights, hessian_function, weighted_hessians
from casadi_contact.networks.network import Network, Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.confidence import Confidence
from casadi_contact.surrogate.file import Content, write_file
from casadi_contact.surrogate.functions import SurrogateFunctions
from casadi_contact.surrogate.info import SurrogateInfo
from casadi_contact.surrogate.kernel import BATCH_FROM, SurrogateArrays

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples


class Surrogate(SurrogateFunctions):
    """Networks and the scene they were trained for; how loads are shared out among networks is the structure's.

    networks: by name; record: what trained them (see `casadi_contact.surrogate.info`), plain JSON values; confidence:
    what `validity` and `expected_error` are made of (see `casadi_contact.surrogate.calibration`).
    compiled: arrays of `BATCH_FROM` poses
    or more go through a C kernel (see `casadi_contact.surrogate.kernel`), as `load_surrogate` wants it.
    """

    structure: ClassVar[str]
    title: ClassVar[str]
    """What charts call it."""
    budget_shares: ClassVar[Mapping[str, float]] = {}
    """Share of a size's budget [Gflop] that a network gets in a chart, by the start of its name; 1 for all others."""

    @staticmethod
    def fits(scene: Scene) -> bool:
        """True where this structure can stand for the scene's loads."""
        return True

    @classmethod
    @abstractmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """Every network this structure can have for a scene, with its number of inputs."""

    @classmethod
    def network_outputs(cls, scene: Scene) -> dict[str, int]:
        """The same networks, each with its number of outputs."""
        return dict.fromkeys(cls.network_inputs(scene), 1)

    @staticmethod
    @abstractmethod
    def regressions(samples: Samples) -> list[Regression]:
        """The regressions, one for each network, that samples pose."""

    @classmethod
    def twins(cls, scene: Scene) -> dict[str, str]:
        """Networks that need no training, each with the one that it is the mirror image of (`reflection`)."""
        return {}

    @staticmethod
    def reflection(name: str, network: Network, scene: Scene) -> Network:
        """The twin `name` of a network."""
        raise NotImplementedError(f"network {name!r} is the mirror image of none")

    @classmethod
    def required_networks(cls, scene: Scene) -> list[str]:
        """Names of the networks that a surrogate of the scene must have; all that it can have unless said otherwise."""
        return list(cls.network_inputs(scene))

    @classmethod
    @abstractmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        """Names of the networks that the scene's loads need."""

    def __init__(
        self,
        scene: Scene,
        networks: Mapping[str, Network],
        record: Mapping[str, Any] | None = None,
        confidence: Confidence | None = None,
        *,
        compiled: bool = False,
    ) -> None:
        self.scene = scene
        self._compiled = compiled
        self._hessians: dict[tuple[str, ...], ca.Function] = {}
        self._kernels = {}
        self.networks = dict(networks)
        self.record = dict(record or {})
        self.confidence = confidence
        self.patch_names = scene.patch_names
        known, outputs = self.network_inputs(scene), self.network_outputs(scene)
        for name, network in self.networks.items():
            if name not in known:
                wanted = f"a {self.structure} surrogate of {scene.name!r}, expected one of {', '.join(known)}"
                raise ValueError(f"unknown network {name!r} for {wanted}")
            size, expected = (len(network.input_shift), network.outputs), (known[name], outputs[name])
            if size != expected:
                raise ValueError(f"network {name!r} has (inputs, outputs) {size}, expected {expected}")
        if missing := [name for name in self.required_networks(scene) if name not in self.networks]:
            raise ValueError(f"a {self.structure} surrogate of {scene.name!r} lacks the networks {', '.join(missing)}")
        self.load_names = scene.load_names

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scene.name}, networks: {len(self.networks)})"

    @batched
    def __call__(self, poses: Array, loads: Iterable[str] | None = None, velocities: ArrayLike | None = None) -> Array:
        """Loads (n, L) for poses (n, 6), or (L,) for a pose (6,): ``load_names``, or the loads asked for; velocities:
        rates (n, 6) of the poses, with which loads hold the scene's friction (`surrogate.sliding`)."""
        names = check_loads(self.load_names, loads)
        if velocities is not None:
            moving = self.function(names, velocity=True).map(len(poses))
            return np.asarray(moving(poses.T, checked_velocities(poses, velocities).T)).T
        arrays = self._arrays(poses)
        if arrays is not None:
            return arrays.loads(poses, names)
        return map_in_chunks(lambda block: self._loads(block, names, derivative=False)[0], poses)

    @batched
    def jacobian(self, poses: Array, loads: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Loads (n, L) and d loads / d pose (n, L, 6) for poses (n, 6); (L,) and (L, 6) for a pose (6,)."""
        names = check_loads(self.load_names, loads)
        arrays = self._arrays(poses)
        if arrays is not None:
            return arrays.jacobian(poses, names)
        return map_in_chunks(lambda block: self._loads(block, names, derivative=True), poses)

    @batched
    def hessian(self, poses: Array, weights: ArrayLike, loads: Iterable[str] | None = None) -> Array:
        """Second derivatives by the pose (n, 6, 6) of Σ weights·loads, weights (L,) or (n, L); (6, 6) for a pose (6,).

        Raises ValueError for weights of another shape.
        """
        names = check_loads(self.load_names, loads)
        wanted = as_weights(weights, len(poses), names)
        arrays = self._arrays(poses)
        if arrays is not None:
            return arrays.hessian(poses, wanted, names)
        if names not in self._hessians:
            self._hessians[names] = hessian_function(self.function(names, compiled=False))
        return weighted_hessians(self._hessians[names], poses, wanted)

    @batched
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root loads s (n, P), s = √(N/N0) in contact and negative outside, and ds/dpose (n, P, 6).

        (P,) and (P, 6) for a pose (6,).
        """
        return map_in_chunks(lambda block: self._roots(block, derivative=True), poses)

    @batched
    def jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """All that `jacobian` and `root_loads` return; NumPy evaluates the networks once for both."""
        arrays = self._arrays(poses)
        if arrays is not None:
            return *arrays.jacobian(poses, self.load_names), *self.root_loads(poses)
        return map_in_chunks(self._jacobian_and_roots, poses)

    @abstractmethod
    def _loads(self, poses: Array, loads: Sequence[str], *, derivative: bool) -> tuple[Array, Array]:
        """Loads (n, L) and their derivatives (n, L, 6), (0, L, 6) if not asked for."""

    @abstractmethod
    def _roots(self, poses: Array, *, derivative: bool) -> tuple[Array, Array]:
        """Root loads (n, P) and their derivatives (n, P, 6), (0, P, 6) if not asked for."""

    def _jacobian_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """See `jacobian_and_roots`."""
        return *self._loads(poses, self.load_names, derivative=True), *self._roots(poses, derivative=True)

    def _arrays(self, poses: Array) -> SurrogateArrays | None:
        """The kernel for so many poses; None where they are few, and without a compiler."""
        many = self._compiled and len(poses) >= BATCH_FROM
        return self._compiled_kernel(self.load_names) if many else None

    @property
    def confidence_columns(self) -> Sequence[int]:
        """Columns of the pose that, with the root loads, describe a contact: the insensitive parameters where the root
        loads stand for the sensitive ones, else (a ball in a cup) all six."""
        sensitive = self.scene.sensitive_pose
        left = sensitive if len(sensitive) <= len(self.scene.patch_names) else ()
        return [k for k, name in enumerate(POSE_NAMES) if name not in left]

    def confidence_roots(self, poses: Array) -> Array:
        """Signed root loads (n, P) that validity and expected error depend on."""
        roots: Any = self._validity_roots
        return map_in_chunks(lambda block: roots._roots(block, derivative=False)[0], poses)

    @batched
    def validity(self, poses: Array) -> Array:
        """Validity (n,) of poses (n, 6): 1 well inside the learned region, 0 far outside; see `confidence`."""
        confidence, arrays = self.require_confidence(), self._arrays(poses)
        if arrays is not None:
            return arrays.validity(poses)
        return map_in_chunks(lambda block: confidence.validity(block, self.confidence_roots(block)), poses)

    @batched
    def expected_error(self, poses: Array, *, sliding: bool = False) -> Array:
        """Expected error (n, L) [N, N·mm] of ``load_names``: 95 % of unseen errors lie below it; see `confidence`.
        sliding: with what the scene's friction adds where bodies slide (`surrogate.sliding`)."""
        confidence, arrays = self.require_confidence(), self._arrays(poses)
        if sliding:
            pressed = self.scene.reference_load * np.sum(np.maximum(self.root_loads(poses)[0], 0.0) ** 2, axis=1)
            coefficient = max(self.scene.friction.static_friction, self.scene.friction.dynamic_friction)
            return self.expected_error(poses) + coefficient * pressed[:, None] * self.sliding.shares
        if arrays is not None:
            return arrays.expected_error(poses)
        return map_in_chunks(lambda block: confidence.expected_errors(block, self.confidence_roots(block)), poses)

    def example_pose(self) -> list[float]:
        """A pose (6) in the learned region, in contact if possible; uncalibrated, the ranges' middle, or zeros."""
        if self.confidence is None:
            ranges = self.record.get("pose_range", {})
            return [float(np.mean(ranges.get(name, 0.0))) for name in POSE_NAMES]
        # The centres, and as many poses that Newton's method presses from there with ten boundary loads a patch.
        poses = self.confidence.centre_poses
        target = np.sqrt(10.0 * self.scene.boundary_load / self.scene.reference_load)
        sensitive, pressed_poses = self.scene.sensitive_pose or self.scene.pose_space.free_names, poses.copy()
        columns = [pose_index(name) for name in sensitive]
        for _ in range(8):
            roots, slopes = self.root_loads(pressed_poses)
            steps = np.einsum("njp,np->nj", np.linalg.pinv(slopes[:, :, columns]), target - roots)
            pressed_poses[:, columns] += np.clip(steps, -1.0, 1.0)
        poses = np.vstack([poses, pressed_poses])
        validity = self.validity(poses)
        pressed = np.where(validity >= min(0.9, validity.max()), self.confidence_roots(poses).min(axis=1), -np.inf)
        return [float(value) for value in poses[np.argmax(pressed)]]

    def info(self) -> SurrogateInfo:
        """What this surrogate is, what it was trained on and how wrong it is; print it."""
        return SurrogateInfo(self.structure, self.scene, self.load_names, self.networks, self.record)

    def save(self, path: str | Path) -> None:
        """Write an HDF5 file that `load_surrogate` reads; raises OSError where it cannot be written."""
        write_file(path, Content(self.structure, self.scene, self.networks, self.record, self.confidence))


_ROWS = 2000  # whatever the number of threads, so that this does not change a bit of the results
_Arrays = TypeVar("_Arrays", bound=Array | tuple[Array, ...])


def map_in_chunks(function: Callable[[Array], _Arrays], poses: Array) -> _Arrays:
    """What a function of poses (n, 6) returns, an array (n, ...) or a tuple of such, from blocks of the poses."""
    if len(poses) <= _ROWS:
        return function(poses)
    blocks = [poses[first : first + _ROWS] for first in range(0, len(poses), _ROWS)]
    with ThreadPoolExecutor(thread_count()) as pool:
        found = list(pool.map(function, blocks))
    if isinstance(found[0], tuple):
        return cast(_Arrays, tuple(np.concatenate(parts) for parts in zip(*found, strict=True)))
    return cast(_Arrays, np.concatenate(found))
