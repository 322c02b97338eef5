"""Errors by domain on held-back samples [EF15 Tables 2, 3], and times and errors of every candidate, in one run on one
thread, on unseen walking [EF15 Table 4]."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.core.machine import machine_record
from casadi_contact.core.workers import one_thread
from casadi_contact.samples.chunk import pressed
from casadi_contact.samples.models import MODELS, model_name_of
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import LoadErrors, LoadModel, Samples, domain_errors, load_errors
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import STRUCTURES, ready_surrogates
from casadi_contact.workflow.benchmark.candidates import (
    EF_FAMILY,
    Candidate,
    charted_surrogates,
    compare,
    finite_element_candidates,
    own_name,
    surrogate_candidates,
    untrained_candidates,
)
from casadi_contact.workflow.benchmark.front_file import FILE_NAME, Front, Point, write_front
from casadi_contact.workflow.project import Project, available_poses, built_in_motion, has_motion, read_motion


def unseen_walking(model: ContactModel, motion: ReferenceMotion, count: int = 5, seed: int = 51) -> Array:
    """Poses (n, 6) of `count` new cycles: random weighted means of the reference cycles' sample-point inputs, which lie
    inside the reference envelopes and so inside D1. A single cycle has no others to go between: each of its inputs is
    shifted instead, by up to half of how far D1 reaches beside it. Frames that do not settle are left out."""
    cycles, rng = len(motion.curves), np.random.default_rng(seed)
    if cycles == 1:
        settings = SamplingSettings.from_scene(model.scene)
        fixed = {name: d1 for name, (d1, _) in settings.fixed_offsets.items()}
        box = motion.envelopes.expand(settings.d1_fraction, settings.d1_offset, fixed)
        curves = motion.curves + 0.5 * rng.uniform(-0.5, 0.5, (count, 1, len(box.names))) * box.widths
    else:
        curves = np.einsum("wc,cfi->wfi", rng.dirichlet(np.ones(cycles), size=count), motion.curves)
    inputs = curves.reshape(-1, curves.shape[2])
    loads = {name: inputs[:, motion.point.inputs.index(name)] for name in motion.point.load_inputs}
    if not motion.point.free:
        poses = pressed(model, motion.starts(inputs), loads)
        return poses[np.isfinite(poses).all(axis=1)]
    poses, report = settle(model, motion.starts(inputs), motion.point.free, loads)
    return poses[report.converged]


def converged_elements(scene: Scene) -> tuple[int, int]:
    """Elements per side of the EF that errors on walking are measured against: twice the teacher's."""
    along, across = scene.grids["teacher"]
    return 2 * along, 2 * across


def evaluate(surrogates: Mapping[str, Surrogate], samples: Samples) -> dict[str, dict[str, LoadErrors]]:
    """Errors of each surrogate on the held-back samples, by model, domain and load; also of the EF's fine and coarse
    grids, unless the samples are of a user's own contact model."""
    scene = samples.scene
    compared = scene.layer is not None and model_name_of(samples) is not None
    grids = (scene.grids["coarse"], scene.grids["fine"]) if compared else ()
    models: dict[str, LoadModel] = {f"EF {grid_text(grid)}": ElasticFoundation(scene, grid) for grid in grids}
    return {name: domain_errors(model, samples) for name, model in (models | {**surrogates}).items()}


# A slow model is timed on fewer poses, so that one measurement takes about this long at most.
_MEASUREMENT_S = 0.3
_FIRST_LOOK = 8
_POSES = 505

# What a peer may fail with; a model that fails stays in the table and says why.
_FAILURES = (ValueError, ArithmeticError, RuntimeError, MemoryError)

Tell = Callable[[str], None]
Peers = Callable[[Samples], Iterable[Candidate]]
"""Samples -> models of other methods that learned from them."""


def measure_project(project: Project, *, peers: Peers | None = None, tell: Tell | None = None) -> Path:
    """Measure the surrogates at hand (see `charted_surrogates`), what needs no training, and peers; write
    ``speed_accuracy.csv`` and return its path. Surrogates of finite elements are compared with these. In scenes without
    geometry and of a table only times are measured. tell: called with what is measured next."""
    scene, candidates = project.scene, list[Candidate]()
    compared = scene.layer is not None and (not project.has_results or has_motion(project))
    reference: Any = EF_FAMILY if compared else None
    shown_as_graph = [*ready_surrogates(), *map(own_name, STRUCTURES)]
    if compared:
        motion = read_motion(project).motion if project.has_results else built_in_motion(scene)
        poses = unseen_walking(ElasticFoundation(scene, scene.grids["settle"]), motion)
        candidates += untrained_candidates(scene)
        drawn_from = [surrogate.record.get("drawn_from") for _, surrogate in charted_surrogates(project)]
        if drawn_from[-1:] == ["finite-elements"]:  # shipped ones come first
            springs, reference = MODELS["finite-elements"](scene, SamplingSettings.from_scene(scene))
            poses, known = unseen_walking(springs, motion), project.samples_path.is_file()
            candidates += finite_element_candidates(reference, poses, project.samples() if known else None)
    else:
        poses = available_poses(project)[:_POSES]
    for name, surrogate in charted_surrogates(project):
        candidates += surrogate_candidates(name, surrogate, graph=name in shown_as_graph)
    if peers is not None:
        candidates += peers(project.samples())
    path = project.folder / FILE_NAME
    front = measure(candidates, scene, poses, tell, reference=reference)
    write_front(path, Front({**front.header, "preset": project.preset_name}, front.points))
    return path


def measure(
    candidates: Iterable[Candidate], scene: Scene, poses: Array, tell: Tell | None = None, *, reference: Any = EF_FAMILY
) -> Front:
    """Errors of all candidates on poses (n, 6) against the reference, a contact model or None (the converged EF if left
    out), and times, in turn within one run on one thread. A candidate that fails becomes a point that says why."""
    tell = tell or (lambda what: None)
    candidates, grid, converged = list(candidates), "none", None
    if reference is not None:
        if reference == EF_FAMILY:
            reference = ElasticFoundation(scene, converged_elements(scene))
        tell(f"errors against {reference.label}")
        grid, converged = reference.label, reference(poses)
    points: dict[str, Point] = {}
    measurements: dict[tuple[str, str], Callable[[], float]] = {}
    with one_thread():
        for candidate in candidates:
            name = candidate.point.name
            tell(name)
            if name in points:
                raise ValueError(f"two candidates are called {name!r}, expected names that differ")
            try:
                points[name] = _with_errors(candidate, scene, poses, converged)
                if not points[name].failure:
                    measurements |= _measurements(candidate, poses)
            except _FAILURES as error:
                points[name] = replace(candidate.point, failure=" ".join(str(error).split()))
        tell("times")
        for (name, what), timing in compare(measurements).items():
            points[name] = replace(points[name], **{what: timing})  # type: ignore[arg-type]
    return Front(header_of(scene, grid, walking_poses=str(len(poses))), tuple(points.values()))


def header_of(scene: Scene, reference: str, **more: str) -> dict[str, str]:
    """What a front of a scene is measured on, on one thread."""
    said = {"scene": scene.name, "scene_digest": scene.digest, "loads": " ".join(scene.load_names), **more}
    return {**said, "reference": reference, "threads": "1", **machine_record()}


def _measurements(candidate: Candidate, poses: Array) -> dict[tuple[str, str], Callable[[], float]]:
    """Measurements by name and kind of time; single calls on as many poses as the time for one allows."""
    found: dict[tuple[str, str], Callable[[], float]] = {}
    for what, stopwatch in candidate.stopwatches.items():
        stopwatch(poses[:_FIRST_LOOK])  # compiles, fills caches
        seconds = stopwatch(poses[:_FIRST_LOOK])
        count = min(len(poses), max(_FIRST_LOOK, math.ceil(_MEASUREMENT_S / max(seconds, 1e-9))))
        found[candidate.point.name, what] = partial(stopwatch, poses[:count])
    return found


def _with_errors(candidate: Candidate, scene: Scene, walking: Array, converged: Array | None) -> Point:
    """The candidate's row with its errors, if there is something to compare with, without times."""
    model, point = candidate.model, candidate.point
    if model is None:
        return replace(point, failure=point.failure or "no model")
    if converged is None:
        return point
    columns = [scene.load_names.index(load) for load in model.load_names]
    errors = load_errors(model.load_names, model(walking), converged[:, columns])
    if not all(math.isfinite(error["rms"]) for error in errors.values()):
        return replace(point, failure="gives NaN or infinity on the walking poses")
    return replace(point, load_rms={load: error["rms"] for load, error in errors.items()})
