"""Errors by domain on held-back samples [EF15 Tables 2, 3], and the unseen walking that speed and accuracy are stated
on [EF15 Table 4]."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.samples.models import model_name_of, settings_of
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import LoadErrors, LoadModel, Samples, domain_errors
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate


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


def converged_elements(scene: Scene) -> tuple[int, int]:
    """Elements per side of the EF that errors on walking are measured against: twice the teacher's."""
    along, across = scene.grids["teacher"]
    return 2 * along, 2 * across


def evaluate(surrogates: Mapping[str, Surrogate], samples: Samples) -> dict[str, dict[str, LoadErrors]]:
    """Errors of each surrogate on the held-back samples, by model, domain and load.

    Also of the EF's fine and coarse grids, unless the samples are of a user's own contact model, from which an EF of
    the scene differs by more than the surrogates do.
    """
    scene = samples.scene
    compared = scene.layer is not None and model_name_of(samples) is not None
    grids = (scene.grids["coarse"], scene.grids["fine"]) if compared else ()
    models: dict[str, LoadModel] = {f"EF {grid_text(grid)}": ElasticFoundation(scene, grid) for grid in grids}
    return {name: domain_errors(model, samples) for name, model in (models | {**surrogates}).items()}


def teacher_text(samples: Samples) -> str:
    """What samples were drawn from, as titles say it: the EF's grid, another model's name, or themselves."""
    drawn_from = model_name_of(samples)
    if drawn_from == "elements":
        return f"EF {grid_text(settings_of(samples).teacher_grid)}"
    return {None: "the samples", "foundation": "cc.foundation"}.get(drawn_from, str(drawn_from))
