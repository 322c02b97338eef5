"""The methods that are compared, all as contact models of one scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from casadi_contact.contact import CallableModel, ElasticFoundation, foundation
from casadi_contact.conventions import Array
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.scenes import Scene
from casadi_contact.structures import Surrogate, load_surrogate
from problems import pose_estimation
from problems.studies.stability.peers import PEERS, peer_models

PATCH, TWO_STAGE = "patch", "two-stage"
EF_COARSE, EF_FINE, EF_ANALYTIC = "EF coarse, differences", "EF fine, differences", "EF fine, analytic"
FOUNDATION = "foundation"
METHODS = (PATCH, TWO_STAGE, FOUNDATION, EF_COARSE, EF_FINE, EF_ANALYTIC, *PEERS)
SURROGATES = (PATCH, TWO_STAGE)
SYMBOLIC = (*SURROGATES, FOUNDATION)
BY_DIFFERENCES = (EF_COARSE, EF_FINE)


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
    patch: str = "knee_patch", two_stage: str = "knee_two_stage", *, peer_points: int = 1000, peer_gflop: float = 300.0
) -> Bench:
    """Load or build every method. Peers are fitted as `peer_models` says and left out, with the reason, where a package
    is absent. Raises FileNotFoundError for an unknown surrogate."""
    surrogate, paper = load_surrogate(patch), load_surrogate(two_stage)
    scene = surrogate.scene
    grids = {name: ElasticFoundation(scene, scene.grids[name]) for name in ("coarse", "fine", "teacher")}
    solved = pose_estimation.solve(pose_estimation.build(surrogate, reference_cycle()))
    if not solved.converged.all():
        raise ValueError(f"surrogate {patch} does not solve the reference cycle: {solved.ipopt_status}")
    peers, missing = peer_models(grids["fine"], solved.poses, peer_points, peer_gflop)
    models: dict[str, Any] = {
        PATCH: surrogate,
        TWO_STAGE: paper,
        FOUNDATION: foundation(scene),
        EF_COARSE: CallableModel(scene, grids["coarse"].wrenches),
        EF_FINE: CallableModel(scene, grids["fine"].wrenches),
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
