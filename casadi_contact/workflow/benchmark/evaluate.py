"""The paper's tables for a scene: domain errors, and speed and accuracy on unseen walking (Tables 2 to 4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.core.machine import machine_record
from casadi_contact.core.workers import one_thread
from casadi_contact.samples.models import model_name_of, settings_of
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import DOMAINS, TEST, LoadModel, Samples, domain_errors, load_errors, rms_by_kind
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.timing import compare, time_batch, time_single_calls


def unseen_walking(model: ContactModel, motion: ReferenceMotion, count: int = 5, seed: int = 51) -> Array:
    """Poses (n, 6) of `count` new cycles: random weighted means of the reference cycles' sample-point inputs.

    Weighted means lie inside the reference envelopes and so inside D1, and none is a reference cycle or a sample. A
    single cycle has no others to go between: each of its inputs is shifted instead, by up to half of how far D1 reaches
    beside it. Each frame is settled on the given model; frames that do not settle are left out.
    """
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
    poses, report = settle(model, motion.starts(inputs), motion.point.free, loads)
    return poses[report.converged]


FURTHER_GRIDS = ((20, 15), (160, 80))  # timed beside the scene's own, so that the EF's speed and accuracy make a curve


def converged_elements(scene: Scene) -> tuple[int, int]:
    """Elements per side of the EF that errors on walking are measured against: twice the teacher's."""
    along, across = scene.grids["teacher"]
    return 2 * along, 2 * across


def evaluate_walking(surrogates: Mapping[str, Surrogate], poses: Array) -> dict[str, Any]:
    """Errors of EF grids and surrogates against the fine and the converged EF, and their time per pose, in one run.

    All on one core: EF as one batch of poses (its cheapest form), surrogates by single buffered calls of their
    compiled kernel.
    """
    scene = next(iter(surrogates.values())).scene
    converged_grid = converged_elements(scene)
    converged = ElasticFoundation(scene, converged_grid)(poses)
    grids = sorted({*FURTHER_GRIDS, *(scene.grids[g] for g in ("coarse", "fine", "teacher"))})
    foundations = {f"EF {grid_text(grid)}": ElasticFoundation(scene, grid) for grid in grids}
    fine = foundations[f"EF {grid_text(scene.grids['fine'])}"](poses)
    measurements: dict[str, Callable[[], float]] = {}
    for name, foundation in foundations.items():
        measurements[name] = partial(time_batch, foundation, poses)
    for name, surrogate in surrogates.items():
        measurements[name] = partial(time_single_calls, surrogate.function(compiled=True), poses)
    with one_thread():
        timings = compare(measurements)
    rows: dict[str, Any] = {}
    models: dict[str, LoadModel] = {**foundations, **surrogates}
    for name, model in models.items():
        names, loads = model.load_names, model(poses)
        columns = [scene.load_names.index(load) for load in names]
        errors = load_errors(names, loads, converged[:, columns])
        rows[name] = {
            "timing": asdict(timings[name]),
            "converged": rms_by_kind(errors),
            "fine": rms_by_kind(load_errors(names, loads, fine[:, columns])),
            "loads": errors,
        }
    return {
        "poses": len(poses),
        "fine": grid_text(scene.grids["fine"]),
        "converged": grid_text(converged_grid),
        "models": rows,
    }


def evaluate(surrogates: Mapping[str, Surrogate], samples: Samples, motion: ReferenceMotion | None) -> dict[str, Any]:
    """Everything `report.evaluation_tables` shows, as plain JSON data.

    Domain errors of each surrogate and of the EF's fine and coarse grids on the held-back samples, against what these
    were drawn from ("teacher": the EF's grid, or another model's name); the walking sequence as in `evaluate_walking`.
    Without a motion, and for samples of a user's own contact model, from which an EF of the scene differs by more than
    the surrogates do, the domain errors of the surrogates alone.
    """
    scene = samples.scene
    models: dict[str, LoadModel] = {}
    drawn_from = model_name_of(samples)
    compared = motion is not None and scene.layer is not None and drawn_from is not None
    for grid in (scene.grids["coarse"], scene.grids["fine"]) if compared else ():
        models[f"EF {grid_text(grid)}"] = ElasticFoundation(scene, grid)
    models |= surrogates
    test = samples.select(role=TEST)
    content = {
        "format": "casadi_contact evaluation",
        "format_version": 1,
        "scene": scene.name,
        "scene_digest": scene.digest,
        "machine": machine_record(),
        "loads": list(scene.load_names),
        "teacher": grid_text(settings_of(samples).teacher_grid) if drawn_from == "elements" else drawn_from,
        "test_samples": {d: int((test.domain == k).sum()) for k, d in enumerate(DOMAINS, start=1)},
        "domain_errors": {name: domain_errors(model, samples) for name, model in models.items()},
    }
    if compared and motion is not None:
        walking = unseen_walking(ElasticFoundation(scene, scene.grids["settle"]), motion)
        content["walking"] = evaluate_walking(surrogates, walking)
    return content
