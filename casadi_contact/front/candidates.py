"""What stands on the chart: elastic foundations, the preset's own surrogates, the ladder of sizes, and peers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import casadi as ca
import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.evaluation.candidate import Candidate
from casadi_contact.evaluation.evaluate import grid_text
from casadi_contact.evaluation.front_file import SIZE
from casadi_contact.evaluation.timing import time_batch, time_mapped, time_single_calls
from casadi_contact.front.sizes import planned, sized_path
from casadi_contact.pipeline import Project, read_motion, trained
from casadi_contact.scenes import Scene
from casadi_contact.surrogate import Surrogate, load_surrogate

EF_FAMILY = "EF"
MX_SUFFIX = " (CasADi MX)"  # follows name and family of a function that is also shown in another form
GRIDS = ((20, 15), (40, 30), (80, 40), (160, 80), (320, 160))


def foundation_candidates(scene: Scene) -> Iterator[Candidate]:
    """EF grids up to the teacher's, timed as one batch of poses, which is their cheapest form."""
    teacher = scene.grids["teacher"]
    grids = {
        grid for grid in (*GRIDS, scene.grids["coarse"], scene.grids["fine"]) if math.prod(grid) < math.prod(teacher)
    }
    for grid in sorted({*grids, teacher}):
        model = ElasticFoundation(scene, grid)
        batch = partial(time_batch, model)
        yield Candidate(
            name=f"EF {grid_text(grid)}",
            family=EF_FAMILY,
            model=model,
            time_value=batch,
            time_jacobian=partial(time_batch, model.jacobian),
            time_batch=batch,
            remark="timed as one batch of poses",
        )


def functions(surrogate: Surrogate, loads: Sequence[str] | None = None) -> dict[str, ca.Function]:
    """The CasADi functions pose -> loads of a surrogate that the chart shows, by what follows the family's name."""
    return {"": surrogate.function(loads)}


def surrogate_candidates(name: str, surrogate: Surrogate, loads: Sequence[str] | None = None) -> Iterator[Candidate]:
    """A surrogate as its CasADi functions, called through their buffers: the way an optimiser does."""
    record = surrogate.record
    for suffix, function in functions(surrogate, loads).items():
        yield Candidate(
            name=f"{name}{suffix}",
            family=f"{surrogate.structure}{suffix}",
            model=surrogate,
            time_value=partial(time_single_calls, function),
            time_jacobian=partial(time_single_calls, function.jacobian()),
            time_hessian=partial(_time_hessian, lagrangian_hessian(function)),
            time_batch=partial(_time_map, function),
            samples=sum(record.get("samples", {}).values()),
            training_seconds=round(sum(record.get("seconds", {}).values()), 1),
            parameters=sum(network.parameter_count for network in surrogate.networks.values()),
            remark="batch: CasADi map",
        )


def project_surrogates(project: Project) -> Iterator[tuple[str, str, Surrogate]]:
    """Name on the chart, sweep, surrogate: the preset's own, then the sized ones that are on disk."""
    for structure, surrogate in trained(project).items():
        yield own_name(project, structure), SIZE, surrogate
    for sized in planned(project.preset.chart):
        yield sized.name, sized.sweep, load_surrogate(sized_path(project, sized))


def own_name(project: Project, structure: str) -> str:
    """Name on the chart of the surrogate that `casadi-contact train` makes: "patch standard"."""
    return f"{structure} {project.preset_name}"


def peer_candidates(project: Project) -> Iterator[Candidate]:
    """The peers, fitted on the project's samples for the preset's seconds each."""
    from casadi_contact.peers import peer_candidates as fitted_peers  # type: ignore[import-untyped,import-not-found]

    yield from fitted_peers(
        project.samples(),
        seconds=project.preset.chart.peer_seconds,
        two_stage=trained(project).get("two_stage"),
        motion=read_motion(project)[0],
    )


def lagrangian_hessian(function: ca.Function) -> ca.Function:
    """pose, λ -> Hessian of λᵀ·loads by the pose, the way nlpsol builds it."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    lagrangian = ca.dot(weights, function(pose))
    return ca.Function("lagrangian_hessian", [pose, weights], [ca.hessian(lagrangian, pose)[0]])


def _time_hessian(hessian: ca.Function, poses: Array) -> float:
    return time_single_calls(hessian, poses, np.ones(hessian.numel_in(1)))


def _time_map(function: ca.Function, poses: Array) -> float:
    return time_mapped(function.map(len(poses)), poses)
