"""The methods that are compared, all as contact models of one scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.benchmark.peers.kriging import Kriging, best_kernel
from casadi_contact.benchmark.peers.training_set import TrainingSet
from casadi_contact.contact import CallableModel, ElasticFoundation
from casadi_contact.contact.model import root_of_normal
from casadi_contact.conventions import Array, as_poses
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.scenes import Scene
from casadi_contact.structures import Surrogate, load_surrogate
from problems import pose_estimation
from problems.studies.stability.walking_samples import walking_samples

PATCH, TWO_STAGE = "patch", "two-stage"
EF_COARSE, EF_FINE, EF_ANALYTIC = "EF coarse, differences", "EF fine, differences", "EF fine, analytic"
KRIGING = "Kriging"
METHODS = (PATCH, TWO_STAGE, EF_COARSE, EF_FINE, EF_ANALYTIC, KRIGING)
SURROGATES = (PATCH, TWO_STAGE)
FOUNDATIONS = (EF_COARSE, EF_FINE, EF_ANALYTIC)


class KrigingModel:
    """Kriging of named loads as a contact model: s = √(N/N0) where it predicts contact, 0 without a slope elsewhere.

    kernel: the one that was tuned for it, c·Matérn + nugget.
    """

    def __init__(self, kriging: Kriging, scene: Scene, kernel: Any) -> None:
        self.kriging, self.scene, self.kernel = kriging, scene, kernel
        self.load_names, self.patch_names = scene.load_names, scene.patch_names
        self._normal = [self.load_names.index(name) for name in scene.sensitive_loads]

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return self.kriging(poses)

    def jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Named loads (n, L) and their derivatives by the pose (n, L, 6)."""
        poses = as_poses(poses)
        slopes = [self.kriging.jacobian_one(pose) for pose in poses]
        return self(poses), np.array(slopes).reshape(len(poses), len(self.load_names), 6)

    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """s (n, P) and ds/dpose (n, P, 6)."""
        loads, slopes = self.jacobian(poses)
        return root_of_normal(-loads[:, self._normal], -slopes[:, self._normal], self.scene.reference_load)


@dataclass(frozen=True)
class Bench:
    """What every row needs: the models by method, reasons for those left out, and a solved walking cycle.

    poses (n, 6) carry the reference cycle's loads on the patch surrogate; teacher is the EF on the finest grid.
    """

    models: Mapping[str, Any]
    missing: Mapping[str, str]
    scene: Scene
    teacher: ElasticFoundation
    poses: Array
    settings: Mapping[str, Any] = field(default_factory=dict)

    def surrogate(self, method: str) -> Surrogate:
        """The surrogate behind a method."""
        model = self.models[method]
        assert isinstance(model, Surrogate), method
        return model


def bench(
    patch: str = "knee", two_stage: str = "knee_two_stage", *, kriging_points: int = 1000, kernel_gflop: float = 300.0
) -> Bench:
    """Load or build every method. Kriging is fitted to `walking_samples` and left out, with the reason, where
    scikit-learn is absent. Raises FileNotFoundError for an unknown surrogate."""
    surrogate, paper = load_surrogate(patch), load_surrogate(two_stage)
    scene = surrogate.scene
    grids = {name: ElasticFoundation(scene, scene.grids[name]) for name in ("coarse", "fine", "teacher")}
    models: dict[str, Any] = {
        PATCH: surrogate,
        TWO_STAGE: paper,
        EF_COARSE: CallableModel(scene, grids["coarse"].wrenches),
        EF_FINE: CallableModel(scene, grids["fine"].wrenches),
        EF_ANALYTIC: grids["fine"],
    }
    solved = pose_estimation.solve(pose_estimation.build(surrogate, reference_cycle()))
    if not solved.converged.all():
        raise ValueError(f"surrogate {patch} does not solve the reference cycle: {solved.ipopt_status}")
    missing: dict[str, str] = {}
    try:
        samples = walking_samples(grids["fine"], solved.poses, kriging_points + kriging_points // 4)
        data = TrainingSet.of(samples)
        kernel, _ = best_kernel(data, kernel_gflop)
        models[KRIGING] = KrigingModel(Kriging(data, min(kriging_points, len(data)), kernel), scene, kernel)
    except ImportError as error:
        missing[KRIGING] = str(error)
    settings = {
        "patch": patch,
        "two_stage": two_stage,
        "grids": {name: foundation.grid for name, foundation in grids.items()},
        "kriging_points": kriging_points,
        "difference_steps": "1e-4 mm, 1e-5 rad, central",
    }
    return Bench(models, missing, scene, grids["teacher"], solved.poses, settings)
