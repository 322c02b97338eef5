"""What stands on the chart: contact models without training, surrogates, the ladder of sizes, and peers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation_ladder
from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from casadi_contact.workflow.benchmark.kernel_speed import lagrangian_hessian
from casadi_contact.workflow.benchmark.sizes import chart_surrogates, sized_path
from casadi_contact.workflow.benchmark.timing import Candidate, Stopwatch, time_batch, time_mapped, time_single_calls
from casadi_contact.workflow.project import Project, project_surrogates, read_motion, shipped_surrogates

EF_FAMILY, FOUNDATION_FAMILY = "EF", "foundation"
MX_SUFFIX = " (CasADi MX)"  # follows name and family of a function that is also shown in another form
GRIDS = ((20, 15), (40, 30), (80, 40), (160, 80), (320, 160))


def refuse_without_elements(project: Project) -> None:
    """ValueError where there is no elastic foundation to compare with: a user's own model, or a table of samples."""
    if project.scene.layer is None:
        raise ValueError(
            f"a chart compares with elastic foundations, and scene {project.scene.name} has no geometry for one (shape "
            f"{project.scene.shape}): casadi-contact info tells the errors of a surrogate, "
            f"{project.command('speed')} its times"
        )


def untrained_candidates(
    scene: Scene, loads: Sequence[str] | None = None, names: Collection[str] | None = None
) -> Iterator[Candidate]:
    """What learns nothing: grids of elements, and `cc.foundation` with coarser and finer ones. names: just these."""
    yield from (candidate for candidate in _element_candidates(scene) if names is None or candidate.name in names)
    if names is not None and not any(name.startswith(FOUNDATION_FAMILY) for name in names):
        return
    try:
        for model in foundation_ladder(scene):
            name = f"{FOUNDATION_FAMILY} {model.resolution}"
            if names is None or name in names:
                yield _symbolic_candidate(name, FOUNDATION_FAMILY, model, loads)
    except ValueError as error:  # of a shape without one, or where none is good enough
        yield Candidate(FOUNDATION_FAMILY, FOUNDATION_FAMILY, None, failure=" ".join(str(error).split()))


def _element_candidates(scene: Scene) -> Iterator[Candidate]:
    """EF grids up to the teacher's, laid both ways, timed as one batch of poses, which is their cheapest form."""
    teacher = scene.grids["teacher"]
    grids = {*GRIDS, *(grid[::-1] for grid in GRIDS), scene.grids["coarse"], scene.grids["fine"]}
    for grid in sorted({*(grid for grid in grids if math.prod(grid) < math.prod(teacher)), teacher}, key=math.prod):
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


def surrogate_candidates(
    name: str, surrogate: Surrogate, loads: Sequence[str] | None = None, *, graph: bool = False
) -> Iterator[Candidate]:
    """A surrogate as a compiled kernel and (graph) as a CasADi graph, called through their buffers: the way an
    optimiser does. Without a compiler the kernel is a graph too, and its remark says so."""
    record = surrogate.record
    for compiled, suffix in ((True, ""), (False, MX_SUFFIX))[: 2 if graph else 1]:
        family = f"{surrogate.structure}{suffix}"
        yield replace(
            _symbolic_candidate(f"{name}{suffix}", family, surrogate, loads, compiled=compiled),
            samples=sum(record.get("samples", {}).values()),
            training_seconds=round(sum(record.get("seconds", {}).values()), 1),
            parameters=sum(network.parameter_count for network in surrogate.networks.values()),
        )


def _symbolic_candidate(
    name: str, family: str, model: SymbolicContact, loads: Sequence[str] | None, *, compiled: bool = True
) -> Candidate:
    """A model with CasADi functions, called through their buffers."""
    function = model.function(loads, compiled=compiled)
    return Candidate(
        name=name,
        family=family,
        model=model,
        time_value=partial(time_single_calls, function),
        time_jacobian=partial(time_single_calls, function.jacobian()),
        time_hessian=partial(_time_hessian, lagrangian_hessian(function)),
        time_batch=_batch_stopwatch(model, loads, compiled=compiled),
        remark="compiled kernel" if function.class_name() == "External" else "CasADi graph; batch: its map",
    )


def _batch_stopwatch(model: SymbolicContact, loads: Sequence[str] | None, *, compiled: bool) -> Stopwatch:
    @cache
    def of(count: int) -> ca.Function:
        return model.function(loads, compiled=compiled, batch=count)

    return lambda poses: time_mapped(of(len(poses)), poses)


def charted_surrogates(project: Project) -> Iterator[tuple[str, Surrogate]]:
    """Name on the chart, surrogate: those shipped for the scene, the preset's own, the sized ones on disk."""
    yield from shipped_surrogates(project.scene).items()
    for structure, surrogate in project_surrogates(project).items():
        yield own_name(project, structure), surrogate
    for sized in chart_surrogates(project.preset.chart, project.scene):
        yield sized.name, load_surrogate(sized_path(project, sized))


def own_name(project: Project, structure: str) -> str:
    """Name on the chart of the surrogate that `casadi-contact train` makes: "patch standard"."""
    return f"{structure} {project.preset_name}"


def peer_candidates(project: Project) -> Iterator[Candidate]:
    """The peers, fitted on the project's samples within the preset's budget."""
    from casadi_contact.workflow.benchmark.peers import candidates as peers

    two_stage = project_surrogates(project).get(TwoStageSurrogate.structure)
    gflop, motion = project.preset.chart.peer_gflop, read_motion(project)[0]
    yield from peers.peer_candidates(project.samples(), gflop=gflop, two_stage=two_stage, motion=motion)


def _time_hessian(hessian: ca.Function, poses: Array) -> float:
    return time_single_calls(hessian, poses, np.ones(hessian.numel_in(1)))
