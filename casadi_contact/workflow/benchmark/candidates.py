"""What stands on the chart: contact models without training, surrogates, the ladder of sizes, peers; and stopwatches of
CPU time, on which other programs tell least."""

import math
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation, foundation_ladder
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import FORCE, of_kind
from casadi_contact.core.workers import worker_pool
from casadi_contact.networks.functions import hessian_function
from casadi_contact.networks.network import size_text
from casadi_contact.samples.samples import TEST, LoadModel, Samples, samples_record
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import STRUCTURES, load_surrogate
from casadi_contact.surrogate.on_foundation import OnFoundation
from casadi_contact.workflow.benchmark.front_file import Point, Timing
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import Effort
from casadi_contact.workflow.project import Project, exclusive, shipped_surrogates, trained_surrogates

EF_FAMILY, FE_FAMILY, FOUNDATION_FAMILY = "EF", "FE", "foundation"
MX_SUFFIX = " (CasADi MX)"  # follows name and family of a function that is also shown in another form
GRIDS = ((20, 15), (40, 30), (80, 40), (160, 80), (320, 160))


Name = TypeVar("Name", bound=Hashable)
Stopwatch = Callable[[Array], float]
"""Poses (n, 6) -> CPU seconds per pose, on one thread."""


@dataclass(frozen=True)
class Candidate:
    """A row of the chart that is not measured yet, its model (None where none could be made), and stopwatches of
    `TIMES`: "value" times single calls, as an optimiser makes them, "batch" one call with all poses."""

    point: Point
    model: LoadModel | None = None
    stopwatches: Mapping[str, Stopwatch] = field(default_factory=dict)


def refuse_without_elements(project: Project) -> None:
    """ValueError where there is no elastic foundation to compare with: a user's own model, or a table of samples."""
    if project.scene.layer is None:
        instead = f"casadi-contact info tells a surrogate's errors, {project.command('speed')} its times"
        raise ValueError(f"a chart needs an elastic foundation, scene {project.scene.name} has no geometry: {instead}")


def untrained_candidates(scene: Scene) -> Iterator[Candidate]:
    """What learns nothing: grids of elements up to the teacher's, laid both ways, timed as one batch of poses, which is
    their cheapest form, and `cc.foundation` with coarser and finer ones."""
    teacher = scene.grids["teacher"]
    grids = {*GRIDS, *(grid[::-1] for grid in GRIDS), scene.grids["coarse"], scene.grids["fine"]}
    for grid in sorted({*(grid for grid in grids if math.prod(grid) < math.prod(teacher)), teacher}, key=math.prod):
        yield _batch_candidate(ElasticFoundation(scene, grid), EF_FAMILY)
    try:
        for model in foundation_ladder(scene):
            yield _symbolic_candidate(Point(f"{FOUNDATION_FAMILY} {model.resolution}", FOUNDATION_FAMILY), model)
    except ValueError as error:  # of a shape without one, or where none is good enough
        yield Candidate(Point(FOUNDATION_FAMILY, FOUNDATION_FAMILY, failure=" ".join(str(error).split())))


def _batch_candidate(model: Any, family: str) -> Candidate:
    batch, point = partial(time_batch, model), Point(model.label, family, remark="timed as one batch of poses")
    return Candidate(point, model, {"value": batch, "jacobian": partial(time_batch, model.jacobian), "batch": batch})


def finite_element_candidates(model: Any, poses: Array, samples: Samples | None) -> Iterator[Candidate]:
    """`cc.FiniteElements` of a mesh and of wider ones; springs of the modulus that carries the nearest forces in poses
    (n, 6), the best that one factor does; and `cc.OnFoundation` of 300 of the samples, if there are any."""
    scene, (nx, nz) = model.scene, model.grid
    for wider in (3.0, 2.0, 1.5, 1.0):
        yield _batch_candidate(type(model)(scene, (round(nx / wider), round(nz / wider)), model.mesh), FE_FAMILY)
    with suppress(ValueError):  # of a shape without a foundation: `untrained_candidates` says so
        forces = of_kind(scene.load_names, FORCE)
        found, wanted = foundation(scene)(poses, forces), model(poses, forces)
        factor = float((found * wanted).sum() / (found**2).sum())
        softer = foundation(scene.with_overrides(youngs_modulus=factor * scene.material.youngs_modulus))
        yield _symbolic_candidate(Point(f"scaled foundation {factor:.2f}·E", "scaled foundation"), softer)
        if samples is not None:
            known = np.random.default_rng(0).permutation(np.flatnonzero(samples.role != TEST))[:300]
            few, point = samples.rows(known), Point(f"on foundation {len(known)} samples", "on foundation")
            yield _symbolic_candidate(replace(point, samples=len(known)), OnFoundation.fit(few))


def surrogate_candidates(name: str, surrogate: Surrogate, *, graph: bool = False) -> Iterator[Candidate]:
    """A surrogate as a compiled kernel and (graph) as a CasADi graph, called through their buffers: the way an
    optimiser does. Without a compiler the kernel is a graph too, and its remark says so."""
    record = surrogate.record
    for compiled, suffix in ((True, ""), (False, MX_SUFFIX))[: 2 if graph else 1]:
        point = Point(
            f"{name}{suffix}",
            f"{surrogate.structure}{suffix}",
            samples=sum(record.get("samples", {}).values()),
            training_seconds=round(sum(record.get("seconds", {}).values()), 1),
            parameters=sum(network.parameter_count for network in surrogate.networks.values()),
        )
        yield _symbolic_candidate(point, surrogate, compiled=compiled)


def _symbolic_candidate(point: Point, model: SymbolicContact, *, compiled: bool = True) -> Candidate:
    """A model with CasADi functions, called through their buffers."""
    function, weights = model.function(compiled=compiled), np.ones(len(model.load_names))
    hessian, mapped = hessian_function(function), cache(lambda count: model.function(compiled=compiled, batch=count))
    remark = "compiled kernel" if function.class_name() == "External" else "CasADi graph; batch: its map"
    stopwatches: dict[str, Stopwatch] = {
        "value": partial(time_single_calls, function),
        "jacobian": partial(time_single_calls, function.jacobian()),
        "hessian": lambda poses: time_single_calls(hessian, poses, weights),
        "batch": lambda poses: time_mapped(mapped(len(poses)), poses),
    }
    return Candidate(replace(point, remark=remark), model, stopwatches)


def chart_sizes(project: Project) -> dict[str, tuple[str, dict[str, Effort]]]:
    """Structure and efforts of every surrogate that the preset's chart shows, of the structures that fit the scene, by
    its name on the chart: "patch 12-12"."""
    found = {}
    for structure, efforts in project.preset.charted.items():
        shares = {"": 1.0, **STRUCTURES[structure].budget_shares}
        for effort in efforts if STRUCTURES[structure].fits(project.scene) else ():
            by_network = {name: replace(effort, gflop=share * effort.gflop) for name, share in shares.items()}
            found[f"{structure} {size_text(effort.sizes[-1])}"] = structure, by_network
    return found


def sized_path(project: Project, name: str) -> Path:
    """Where a surrogate of the chart lies in the project's folder."""
    return project.folder / "sizes" / f"{name.replace(' ', '_')}.h5"


def on_disk(project: Project, path: Path | str) -> Surrogate | None:
    """The surrogate at a path or of a shipped name; None where there is none of this scene that can be read."""
    try:
        surrogate = load_surrogate(path)
    except (FileNotFoundError, ValueError):  # damaged or of an older format: made again, from its checkpoints
        return None
    return surrogate if surrogate.scene.digest == project.scene.digest else None


def _made(project: Project, path: Path, learned: Samples) -> bool:
    """Whether a surrogate lies there that was trained on these samples for the tolerances of now."""
    surrogate, record = on_disk(project, path), samples_record(learned)
    if surrogate is None or surrogate.scene.tolerances != project.scene.tolerances:
        return False
    return all(surrogate.record.get(key) == record[key] for key in ("samples", "pose_range", "load_range"))


@exclusive
def train_sizes(project: Project, update: Update | None = None, executor: Executor | None = None) -> None:
    """Train the surrogates of the preset's chart that are not on disk yet, going on from checkpoints."""
    samples = replace(project.samples(), scene=project.scene)  # its tolerances are those of now
    writable_folder(project.folder / "sizes")
    for name, (structure, efforts) in chart_sizes(project).items():
        path = sized_path(project, name)
        if not _made(project, path, samples):
            folder = project.training_folder("sizes", path.stem)
            fitting = Fitting(structure, efforts, folder, project.command("chart"), name)
            with worker_pool(executor) as workers:
                fit_surrogate(project, samples, fitting, update, workers).save(path)


def charted_surrogates(project: Project) -> Iterator[tuple[str, Surrogate]]:
    """Name on the chart, surrogate: those shipped for the scene, the project's own, the sized ones on disk."""
    yield from shipped_surrogates(project.scene).items()
    for structure, surrogate in trained_surrogates(project).items():
        yield own_name(structure), surrogate
    for name in chart_sizes(project):
        if (found := on_disk(project, sized_path(project, name))) is not None:
            yield name, found


def own_name(structure: str) -> str:
    """Name on the chart of the surrogate that lies in the project's folder."""
    return f"own {structure}"


def time_batch(evaluate: Callable[[Array], object], poses: Array) -> float:
    """CPU seconds per pose of one call with all poses."""
    start = time.process_time()
    evaluate(poses)
    return (time.process_time() - start) / len(poses)


def time_single_calls(function: ca.Function, poses: Array, *others: Array) -> float:
    """CPU seconds per call of a CasADi function (pose, *others) -> outputs, called pose by pose through its buffer.

    Includes the copy of each pose into the buffer, as a simulation would make it. Other arguments stay as given."""
    buffer, call = function.buffer()
    pose = np.zeros(poses.shape[1])
    view, rows = memoryview(pose), [memoryview(row) for row in np.ascontiguousarray(poses)]  # type: ignore[arg-type]
    outputs = [np.zeros(function.sparsity_out(i).nnz()) for i in range(function.n_out())]
    buffer.set_arg(0, view)  # type: ignore[call-arg, arg-type]
    for i, value in enumerate(others, start=1):
        buffer.set_arg(i, memoryview(value))  # type: ignore[call-arg, arg-type]
    for i, output in enumerate(outputs):
        buffer.set_res(i, memoryview(output))  # type: ignore[call-arg, arg-type]
    start = time.process_time()
    for row in rows:
        view[:] = row
        call()
    return (time.process_time() - start) / len(poses)


def time_mapped(mapped: ca.Function, poses: Array) -> float:
    """CPU seconds per pose of one buffered call of a CasADi function poses (6 x n) -> outputs, for n = len(poses)."""
    return time_single_calls(mapped, np.reshape(poses, (1, -1))) / len(poses)  # CasADi stores column after column


def compare(measurements: Mapping[Name, Callable[[], float]], repeats: int = 7) -> dict[Name, Timing]:
    """Run each measurement (which returns seconds per pose) once to warm up, then all in turn, `repeats` times."""
    for measure in measurements.values():
        measure()
    seconds: dict[Name, list[float]] = {name: [] for name in measurements}
    for _ in range(repeats):
        for name, measure in measurements.items():
            seconds[name].append(measure())
    us = {name: 1e6 * np.array(values) for name, values in seconds.items()}
    return {name: Timing(float(np.median(t)), float(t.min()), float(t.max())) for name, t in us.items()}
