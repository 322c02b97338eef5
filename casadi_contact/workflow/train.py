"""Train a project's surrogates: each structure of its preset, then the preset's active rounds.

Samples of a plan lie evenly, and so thinly in the corners of six dimensions that a surrogate with an RMS error of a
newton is off by a hundred in some. An active round (`presets.ActiveRound`) draws the plan once more with another seed,
several times as many samples, and adds those on which the surrogate is worst to the training rows. Validation and test
rows stay an even draw of the plan, so that they remain representative.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Progress, Update, stage_progress
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.models import MODELS, ModelPair, model_name_of, settings_of, teacher_of
from casadi_contact.samples.samples import TRAIN, LoadModel, Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.project import Project, exclusive, has_motion, read_motion, trained_surrogates


@exclusive
def train(
    project: Project,
    update: Update | None = None,
    executor: Executor | None = None,
    *,
    structure: str | None = None,
    teacher: WrenchModel | None = None,
) -> list[Path]:
    """Train the preset's structures, or this one alone, on all cores, and write a surrogate file for each.

    teacher: the user's own contact model that the samples come from, for `calibrate`. Goes on from checkpoints where
    an earlier run stopped. Raises ValueError for a structure that the preset does not train or that cannot stand for
    the scene's loads, and for active rounds on samples of another model than the library's.
    """
    structures = [name for name in project.preset.efforts if STRUCTURES[name].fits(project.scene)]
    if structure is not None and structure not in structures:
        raise ValueError(f"structure is {structure!r}, expected one that is trained here: {', '.join(structures)}")
    samples = project.samples()
    if project.preset.active:
        known_models(project, samples)  # refused here, not after hours of training
    model = teacher_of(samples) if teacher is None else teacher
    cycles = read_motion(project).files if has_motion(project) else ()
    command = build_command(project, samples, cycles)
    samples = replace(samples, scene=project.scene)  # its tolerances are those of now
    trained_surrogates(project)  # refuses those of another scene, which would be replaced
    paths = []
    for name in structures if structure is None else [structure]:
        path = project.surrogate_path(name)
        first = Fitting(name, project.preset.efforts[name], project.training_folder(name), command)
        with worker_pool(executor) as workers:
            surrogate = fit_surrogate(project, samples, first, update, workers)
            surrogate = _active_rounds(project, samples, surrogate, first, update, workers)
            calibrate(surrogate, samples, model, update, executor=workers).save(path)
        paths.append(path)
    return paths


def build_command(project: Project, samples: Samples, cycles: Sequence[str], *tolerances: str) -> str:
    """The command line that builds a project's surrogates from nothing; for a user's own model a line of Python.

    cycles: files that the samples were drawn around; tolerances: options of a build to tolerances instead of a preset.
    """
    if "table" in samples.provenance:
        return project.command("build", "--table", samples.provenance["table"])
    drawn_from = model_name_of(samples)
    if drawn_from is None:
        named = f"{project.given or project.scene.name!r}, {project.preset_name!r}"
        made = "casadi_contact.workflow.tolerance.train_to_tolerance" if tolerances else f"cc.build({named}, model=...)"
        return f"{made} in Python, with a contact model of one's own"
    around = [word for path in cycles for word in ("--cycles", path)]
    return project.command("build", "--model", drawn_from, *around, *tolerances, preset=not tolerances)


def _active_rounds(
    project: Project, samples: Samples, surrogate: Surrogate, first: Fitting, update: Update | None, executor: Executor
) -> Surrogate:
    """The surrogate after the active rounds of its structure; first: how it was fitted before them."""
    name, learned = first.structure, samples
    for number, chosen in enumerate(project.preset.active, start=1):
        if name not in chosen.efforts:
            continue
        title = f"{name}, round {number}"
        progress = stage_progress(update, f"{title}: candidates")
        drawn = candidates(project, samples, number, chosen.times, progress, executor)
        learned = learned.join_samples(worst_samples(surrogate, drawn, chosen.worst_share))
        folder, efforts = first.checkpoints / f"active-{number}", chosen.efforts[name]
        further = replace(first, efforts=efforts, checkpoints=folder, title=title)
        surrogate = fit_surrogate(project, learned, further, update, executor, onward=surrogate)
    return surrogate


def known_models(project: Project, samples: Samples) -> ModelPair:
    """The contact models that the samples were drawn from; ValueError for samples of a user's own model or table."""
    name = model_name_of(samples)
    if name is None:
        raise ValueError(f"preset {project.preset_name} draws again, from the library's models alone: choose another")
    return MODELS[name]


def candidates(
    project: Project,
    samples: Samples,
    number: int,
    times: float,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Samples:
    """The plan of the project's samples `times` as large, its seed greater by the round's number; kept in the project's
    folder, and drawn on where an earlier run stopped. Raises ValueError as `known_models`."""
    models = known_models(project, samples)
    settings = settings_of(samples)
    settings = replace(settings, scale=times * settings.scale, seed=settings.seed + number)
    path = project.folder / f"candidates-{number}.h5"
    motion = read_motion(project).motion
    return draw_samples(
        project.scene, motion, path, settings=settings, executor=executor, models=models, progress=progress
    )


def worst_samples(model: LoadModel, samples: Samples, share: float) -> Samples:
    """The share of samples on which a model is worst, and all on which nothing touches, as training rows.

    The error of a sample is max over loads |model - sample|/tolerance, the scene's tolerances. Lifted bodies all belong
    to them because a load error of zero does not tell how near a false contact is.
    """
    tolerances = samples.scene.tolerances_of(model.load_names)
    errors = np.max(np.abs(model(samples.poses) - samples.loads(model.load_names)) / tolerances, axis=1)
    chosen = (samples.wrenches == 0.0).all(axis=(1, 2))
    chosen[np.argsort(-errors, kind="stable")[: round(share * len(samples))]] = True
    worst = samples.rows(chosen)
    return replace(worst, role=np.full(len(worst), TRAIN, dtype=np.uint8))
