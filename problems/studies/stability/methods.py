"""The methods that are compared, as contact models of one scene, and the lines of the table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel, root_of_normal
from casadi_contact.core.conventions import POSE_IN_MM, Array, as_poses
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.normal_load import NormalLoad
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.project import built_in_motion, shipped_surrogates
from problems.studies.peers import LOADS, Peer
from problems.studies.regressors import METHODS, learned

FAILURES = {
    1: "starts out of contact and too deep",
    2: "lift-off and landing",
    3: "poses to three times the learned range",
}
FOUNDATION, EF_DIFFERENCES, EF_ANALYTIC = "foundation", "EF, differences", "EF, analytic"


@dataclass(frozen=True)
class Line:
    """One measured quantity of one failure: for every method a number, a short text, or no entry."""

    row: int
    case: str
    quantity: str
    values: Mapping[str, float | str]

    def cell(self, method: str) -> str:
        """What the table shows: "-" where the quantity makes no sense for a method."""
        value = self.values.get(method)
        if value is None:
            return "-"
        return value if isinstance(value, str) else f"{value:.0f}" if 100.0 <= abs(value) < 1e5 else f"{value:.3g}"


@dataclass(frozen=True)
class Bench:
    """Models by method, poses (n, 6) of the scene's motion, and the EF on the finest grid, which is taken as the truth.

    surrogates: names of the methods that are surrogates; the range of the first is the learned range.
    """

    scene: Scene
    models: Mapping[str, Any]
    surrogates: tuple[str, ...]
    truth: ElasticFoundation
    poses: Array

    @classmethod
    def of(cls, scene_name: str, surrogates: Sequence[str] = (), *, peer_points: int = 400, frames: int = 101) -> Bench:
        """Surrogates (the shipped ones of the scene, or names and paths), foundation, elements, and peers that are
        fitted to peer_points poses about the motion.

        Raises ValueError where the scene has no surrogate, FileNotFoundError for one that is not there.
        """
        scene = load_scene(scene_name)
        learned = {name: load_surrogate(name) for name in surrogates} if surrogates else shipped_surrogates(scene)
        if not learned:
            raise ValueError(f"no surrogate of scene {scene.name} is shipped: name one by --surrogate")
        poses = built_in_motion(scene).poses.reshape(-1, 6)
        elements = ElasticFoundation(scene, scene.grids["fine"])
        models: dict[str, Any] = {
            **learned,
            FOUNDATION: foundation(scene),
            EF_DIFFERENCES: CallableModel(scene, elements.wrenches, elements.gaps),
            EF_ANALYTIC: elements,
            **_peers(elements, poses, peer_points),
        }
        chosen = poses[np.linspace(0, len(poses) - 1, min(frames, len(poses))).astype(int)]
        truth = ElasticFoundation(scene, scene.grids["teacher"])
        return cls(scene, models, tuple(learned), truth, chosen)


def _peers(model: ElasticFoundation, poses: Array, count: int) -> dict[str, PeerModel]:
    """Regressors fitted to poses moved by up to 1 mm (rotations over 25 mm), the sensitive parameters by a fifth."""
    rng, scene = np.random.default_rng(0), model.scene
    size = np.where(
        np.isin(np.arange(6), [("tx", "ty", "tz", "rx", "ry", "rz").index(n) for n in scene.sensitive_pose]), 0.2, 1.0
    )
    drawn = poses[rng.integers(len(poses), size=count)] + size / POSE_IN_MM * rng.uniform(-1.0, 1.0, (count, 6))
    models = {}
    for family, settings in (("polynomial", "3"), ("Gaussian process", "2000 points"), ("radial basis", "4000 points")):
        fit = learned(METHODS[family][settings], drawn[:, list(scene.pose_space.free)], model(drawn), np.ones(count))
        models[family] = PeerModel(Peer(scene, scene.load_names, {LOADS: fit}), scene)
    return models


class PeerModel(ContactModel):
    """A fitted peer as a contact model: s = √(N/N0) where it predicts contact, 0 without a slope elsewhere; its
    Jacobian is by central differences."""

    def __init__(self, peer: Callable[[Array], Array], scene: Scene) -> None:
        self._peer, self.scene = peer, scene
        self.load_names, self.patch_names = scene.load_names, scene.patch_names

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return np.asarray(self._peer(as_poses(poses)))

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, L) and their derivatives by the pose (n, L, 6)."""
        return self(poses), by_differences(self, as_poses(poses), 1e-4)

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """s (n, P) and ds/dpose (n, P, 6)."""
        loads, slopes = self.jacobian(poses)
        rates = np.zeros((len(loads), len(self.patch_names), 6))
        for p, normal in enumerate(self.scene.normal_loads):
            rates[:, p] = normal.gradient(_wrench(self, normal, loads), _wrench(self, normal, slopes))
        return root_of_normal(normal_loads(self, loads), rates, self.scene.reference_load)


def _wrench(model: Any, normal: NormalLoad, loads: Array) -> Array:
    """Named loads (n, L, ...) that a normal load is made of, in their places of a wrench (n, 6, ...) of zeros."""
    wrench = np.zeros((len(loads), 6, *loads.shape[2:]))
    columns = [model.load_names.index(name) for name in normal.loads]
    wrench[:, slice(0, 3) if normal.index is None else [normal.index]] = loads[:, columns]
    return wrench


def normal_loads(model: Any, loads: Array) -> Array:
    """Normal load (n, patches) of named loads (n, L), below zero where a patch pulls."""
    return np.stack([normal.of(_wrench(model, normal, loads)) for normal in model.scene.normal_loads], axis=1)


def by_differences(model: Callable[[Array], Array], poses: Array, step_mm: float) -> Array:
    """d loads / d pose (n, L, 6) by central differences; steps of rotations are step_mm over 25 mm."""
    steps = np.diag(step_mm / POSE_IN_MM)
    return np.stack([(model(poses + s) - model(poses - s)) / (2.0 * s.sum()) for s in steps], axis=-1)


@cache
def _generalised() -> ca.Function:
    pose, wrench = ca.MX.sym("pose", 6), ca.MX.sym("wrench", 6)
    forces = generalised_forces(pose, wrench)
    return ca.Function("parts", [pose, wrench], [forces, ca.jacobian(forces, pose), ca.jacobian(forces, wrench)])


def generalised(model: Any, pose: Array) -> Array:
    """Q = (F, Eᵀ(T - t×F)) (6,) of the contact loads at one pose: what does work on the pose."""
    wrench = total_selection(model.load_names, model.patch_names) @ model(pose[None])[0]
    return np.asarray(_generalised()(pose, wrench)[0]).ravel()


def generalised_jacobian(model: Any, poses: Array) -> Array:
    """dQ/dpose (n, 6, 6) by the chain rule from the model's own Jacobian."""
    total = total_selection(model.load_names, model.patch_names)
    loads, jacobians = model.jacobian(poses)
    found = []
    for at, load, jacobian in zip(poses, loads, jacobians, strict=True):
        _, direct, by_wrench = _generalised()(at, total @ load)
        found.append(np.asarray(direct) + np.asarray(by_wrench) @ (total @ jacobian))
    return np.array(found)
