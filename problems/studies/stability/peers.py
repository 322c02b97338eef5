"""Methods of others as contact models, fitted to as few samples around walking as some of them can take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import comb
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel, root_of_normal
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.history.in_time import SinglePoses
from casadi_contact.workflow.benchmark.peers.history.models import HISTORY_MODELS
from casadi_contact.workflow.benchmark.peers.kriging import Kriging
from casadi_contact.workflow.benchmark.peers.kriging import best_kernel as kriging_kernel
from casadi_contact.workflow.benchmark.peers.lazy_learning import LazyLearner
from casadi_contact.workflow.benchmark.peers.polynomial import Polynomial
from casadi_contact.workflow.benchmark.peers.radial_basis import RadialBasis
from casadi_contact.workflow.benchmark.peers.radial_basis import best_kernel as radial_kernel
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from problems.studies.stability.differences import by_differences
from problems.studies.stability.normals import normal_of, patch_wrench

POLYNOMIAL, KRIGING, RADIAL_BASIS = "polynomial", "Kriging", "radial basis"
LAZY, TIME_DELAY = "lazy learning", "time-delay network"
PEERS = (POLYNOMIAL, KRIGING, RADIAL_BASIS, LAZY, TIME_DELAY)
_POLYNOMIAL_DEGREES, _SAMPLES_A_TERM = (4, 3, 2, 1), 3
_LAZY_TOLERANCES = 10.0
_STEP_MM = 1e-4


class PeerModel(ContactModel):
    """A fitted peer as a contact model: s = √(N/N0) where it predicts contact, 0 without a slope elsewhere.

    Its Jacobian is its own, or central differences with steps of 1e-4 mm (rotations over 25 mm). remembered: what its
    fit found out.
    """

    def __init__(self, peer: Any, scene: Scene, remembered: Any = None) -> None:
        self.peer, self.scene, self.remembered = peer, scene, remembered
        self.load_names, self.patch_names = scene.load_names, scene.patch_names

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return np.asarray(self.peer(as_poses(poses)))

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, L) and their derivatives by the pose (n, L, 6)."""
        poses = as_poses(poses)
        own: Callable[[Array], Array] | None = getattr(self.peer, "jacobian_one", None)
        if own is not None:
            slopes = [own(pose).copy() for pose in poses]
            return self(poses), np.array(slopes).reshape(len(poses), len(self.load_names), 6)
        return self(poses), by_differences(self, poses, _STEP_MM, central=True)

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """s (n, P) and ds/dpose (n, P, 6)."""
        loads, slopes = self.jacobian(poses)
        sizes, rates = normal_of(self, loads), np.zeros((len(loads), len(self.patch_names), 6))
        for p, normal in enumerate(self.scene.normal_loads):
            rates[:, p] = normal.slope(patch_wrench(self, normal, loads), patch_wrench(self, normal, slopes))
        return root_of_normal(sizes, rates, self.scene.reference_load)


def _degree(samples: int) -> int:
    """The highest degree of six variables whose terms have three samples each."""
    return next(d for d in _POLYNOMIAL_DEGREES if _SAMPLES_A_TERM * comb(d + 6, 6) <= samples or d == 1)


def peer_models(
    model: ElasticFoundation, data: TrainingSet, motion: ReferenceMotion, points: int, gflop: float
) -> tuple[dict[str, PeerModel], dict[str, str]]:
    """The peers by name, and for those that lack a package or could not be fitted the reason.

    All are fitted to the first ``points`` rows of the data, but for the time-delay network, which learns the motion in
    order and takes each pose for its past. Lazy learning asks the model where it is not sure within ten tolerances.
    gflop: 10⁹ operations for tuning the kernel of Kriging, and for the network.
    """
    scene, data = model.scene, replace(data, poses=data.poses[:points], loads=data.loads[:points])
    count = min(points, len(data))

    def kriging() -> tuple[Any, Any]:
        kernel, _ = kriging_kernel(data, gflop)
        return Kriging(data, count, kernel), kernel

    def delay() -> tuple[Any, Any]:
        networks = HISTORY_MODELS[TIME_DELAY](Cycles.of(data, motion), gflop)
        return SinglePoses(networks, data.load_names), None

    fits: dict[str, Callable[[], tuple[Any, Any]]] = {
        POLYNOMIAL: lambda: (Polynomial(data, _degree(len(data))), None),
        KRIGING: kriging,
        RADIAL_BASIS: lambda: (RadialBasis(data, count, radial_kernel(data)), None),
        LAZY: lambda: (LazyLearner(data, model, _LAZY_TOLERANCES), None),
        TIME_DELAY: delay,
    }
    models, missing = {}, {}
    for name, fit in fits.items():
        try:
            peer, remembered = fit()
        except (ImportError, ValueError) as error:
            missing[name] = str(error)
            continue
        models[name] = PeerModel(peer, scene, remembered)
    return models, missing
