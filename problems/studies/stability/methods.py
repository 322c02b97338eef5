"""The methods that are compared, all as contact models of one scene: those of the knee, or of any project."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from casadi_contact.workflow.project import Project, built_in_motion, read_motion, surrogates_at_hand
from problems import pose_estimation
from problems.studies.stability.peers import PEERS, peer_models
from problems.studies.stability.walking_samples import walking_samples

PATCH, TWO_STAGE = "patch", "two-stage"
EF_COARSE, EF_FINE, EF_ANALYTIC = "EF coarse, differences", "EF fine, differences", "EF fine, analytic"
FOUNDATION = "foundation"
NETWORKS = "networks"  # of a project, whatever their structure
METHODS = (PATCH, TWO_STAGE, NETWORKS, FOUNDATION, EF_COARSE, EF_FINE, EF_ANALYTIC, *PEERS)
SURROGATES = (PATCH, TWO_STAGE)
BY_DIFFERENCES = (EF_COARSE, EF_FINE)
_FRAMES = 101  # of a project's motion


@dataclass(frozen=True)
class Bench:
    """What every row needs: the models by method, reasons for those left out, and poses of a motion.

    poses (n, 6) carry the reference cycle's loads, of the knee on the patch surrogate; teacher is the EF on the finest
    grid.
    """

    models: Mapping[str, Any]
    missing: Mapping[str, str]
    scene: Scene
    teacher: ElasticFoundation
    poses: Array
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def learned(self) -> Surrogate:
        """The surrogate whose learned range the poses of row 3 go beyond."""
        return self.surrogate(PATCH if PATCH in self.models else NETWORKS)

    def surrogate(self, method: str) -> Surrogate:
        """The surrogate behind a method."""
        model = self.models[method]
        assert isinstance(model, Surrogate), method
        return model


def bench(
    patch: str = "knee", two_stage: str = "knee_two_stage", *, peer_points: int = 1000, peer_gflop: float = 300.0
) -> Bench:
    """Load or build every method. Peers are fitted as `peer_models` says and left out, with the reason, where a package
    is absent. Raises FileNotFoundError for an unknown surrogate."""
    surrogate, paper = load_surrogate(patch), load_surrogate(two_stage)
    scene = surrogate.scene
    grids = {name: ElasticFoundation(scene, scene.grids[name]) for name in ("coarse", "fine", "teacher")}
    solved = pose_estimation.solve(pose_estimation.build(surrogate, reference_cycle()))
    if not solved.converged.all():
        raise ValueError(f"surrogate {patch} does not solve the reference cycle: {solved.ipopt_status}")
    learned_from = walking_samples(grids["fine"], solved.poses, peer_points + peer_points // 4)
    motion = built_in_motion(scene)
    peers, missing = peer_models(grids["fine"], TrainingSet.of(learned_from), motion, peer_points, peer_gflop)
    models: dict[str, Any] = {
        PATCH: surrogate,
        TWO_STAGE: paper,
        FOUNDATION: foundation(scene),
        EF_COARSE: CallableModel(scene, grids["coarse"].wrenches, grids["coarse"].gaps),
        EF_FINE: CallableModel(scene, grids["fine"].wrenches, grids["fine"].gaps),
        EF_ANALYTIC: grids["fine"],
        **peers,
    }
    settings = {
        "patch": patch,
        "two_stage": two_stage,
        "grids": {name: grid.grid for name, grid in grids.items()},
        "peer_points": peer_points,
        "difference_steps": "1e-4 mm, 1e-5 rad, central",
    }
    return Bench(models, missing, scene, grids["teacher"], solved.poses, settings)


def project_bench(project: Project, *, peer_points: int = 1000, peer_gflop: float = 300.0) -> Bench:
    """The networks of a built project, its scene's foundation and elements, and peers fitted to a part of its samples.

    Raises FileNotFoundError where the project holds no surrogate.
    """
    scene, (structure, surrogate) = project.scene, next(iter(surrogates_at_hand(project).items()))
    grids = {name: ElasticFoundation(scene, scene.grids[name]) for name in ("fine", "teacher")}
    motion, _ = read_motion(project)
    peers, missing = peer_models(grids["fine"], TrainingSet.of(project.samples()), motion, peer_points, peer_gflop)
    models: dict[str, Any] = {NETWORKS: surrogate}
    try:
        models[FOUNDATION] = foundation(scene)
    except ValueError as error:
        missing = {**missing, FOUNDATION: str(error)}
    models |= {
        EF_FINE: CallableModel(scene, grids["fine"].wrenches, grids["fine"].gaps),
        EF_ANALYTIC: grids["fine"],
        **peers,
    }
    poses = motion.poses.reshape(-1, 6)
    frames = np.linspace(0, len(poses) - 1, min(_FRAMES, len(poses))).astype(int)
    settings = {
        "scene": scene.name,
        "networks": f"{structure}, preset {project.preset_name}",
        "grids": {name: grid.grid for name, grid in grids.items()},
        "peer_points": peer_points,
        "difference_steps": "1e-4 mm, 1e-5 rad, central",
    }
    return Bench(models, missing, scene, grids["teacher"], poses[frames], settings)
