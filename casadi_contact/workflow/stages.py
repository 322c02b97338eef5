"""Stages of a project: samples, drawn around its motion or taken from a table, then training of its surrogates: each
structure of the preset, then the preset's active rounds.

Samples of a plan lie evenly, and so thinly in the corners of six dimensions that a surrogate with an RMS error of a
newton is off by a hundred in some. An active round (`presets.ActiveRound`) draws the plan once more with another seed,
several times as many samples, and adds those on which the surrogate is worst to the training rows. Validation and test
rows stay an even draw of the plan, so that they remain representative.
"""

from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Progress, Update, stage_progress
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.draw import check_rejection_rate, draw_samples
from casadi_contact.samples.models import (
    MODELS,
    ModelPair,
    model_name_of,
    model_pair,
    models_identity,
    settings_of,
    teacher_of,
)
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.resume import KeptMotion, check_same_plan, earlier_samples, motion_origin
from casadi_contact.samples.samples import TRAIN, LoadModel, Samples, write_samples
from casadi_contact.samples.settings import AROUND_POSES, SamplingSettings
from casadi_contact.samples.table import check_gaps, read_sample_table
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.project import Project, exclusive, has_motion, read_motion, trained_surrogates


def check_single_source(table: str | Path | None, cycles: Sequence[str | Path], model: ContactModel | str) -> None:
    """ValueError for cycles or another model beside a table of samples: nothing is drawn then."""
    if table is not None and (cycles or model != "elements"):
        raise ValueError(f"got a table of samples and {'cycles' if cycles else 'a model'}, expected one of them")


@exclusive
def sample(
    project: Project,
    cycle_files: Sequence[Path] = (),
    update: Update | None = None,
    executor: Executor | None = None,
    model: ContactModel | str = "elements",
) -> tuple[Samples, str]:
    """Estimate the poses of the reference cycles and draw the samples, or go on where an earlier run stopped; returns
    the samples and the report of the motion, which is kept beside them.

    cycle_files: measured cycles (§3.3); the built-in reference motion if empty. model: a name in `MODELS`, or a user's
    own contact model of the scene, which is evaluated in this process. Raises ValueError for samples or surrogates of
    something else in the folder, where more of a domain was dropped than ``most_dropped`` allows and for gaps of the
    wrong sign (the file is kept)."""
    models = model_pair(model)
    if not isinstance(model, str) and model.scene.digest != project.scene.digest:
        raise ValueError(f"the model stands for another scene than {project.scene.name}: make it for this one")
    trained_surrogates(project)
    cycles = reference_motion_cycles(project.scene, cycle_files)
    preset = project.preset
    given: dict[str, Any] = {"scale": preset.sampling_scale, **preset.sampling}
    if not cycles[0].loads:
        offsets = {**AROUND_POSES, **project.scene.sampling.get("fixed_offsets", {})}
        loads = (normal.as_number.loads[0] for normal in project.scene.normal_loads)
        given |= {"inputs": (*project.scene.pose_space.free_names, *loads), "fixed_offsets": offsets}
    settings = SamplingSettings.from_scene(project.scene, **given)
    origin = motion_origin(project.scene, cycles, settings, models_identity(models))
    drawn = earlier_samples(project.samples_path)
    if drawn is not None and project.motion_path.is_file():
        kept = KeptMotion.read(project.motion_path, project.scene.pose_space)
        check_same_plan(kept.origin, origin, drawn)
    else:
        settled_on, progress = models(project.scene, settings)[0], stage_progress(update, "reference motion")
        motion, report = reference_motion(settled_on, cycles, settings, progress)
        kept = KeptMotion(motion, str(report), tuple(map(str, cycle_files)), origin)
        kept.write(project.motion_path)
    progress = stage_progress(update, "samples")
    with nullcontext(executor) if isinstance(model, str) else ThreadPoolExecutor(1) as workers:
        given = {"settings": settings, "executor": workers, "models": models, "progress": progress}
        samples = draw_samples(project.scene, kept.motion, project.samples_path, **given)
    check_rejection_rate(samples, settings.most_dropped)
    if model_name_of(samples) is None:
        check_gaps(samples, str(project.samples_path))
    return samples, kept.report


@exclusive
def take_table(project: Project, table: Path) -> Samples:
    """Make the samples file from a table of samples (`samples.table.read_sample_table`) instead of drawing them.

    Raises ValueError for a folder in which other samples are drawn or learned already."""
    samples = read_sample_table(table, project.scene)
    if project.samples_path.is_file():
        there = project.samples().provenance
        learned = (project.folder / "training").exists() or trained_surrogates(project)
        if there.get("table_digest") != samples.provenance["table_digest"] and (learned or "table" not in there):
            changed = f"was made from {table} as it was before" if there.get("table") == str(table) else "is of others"
            raise ValueError(f"{project.samples_path} {changed}: choose another --out, or remove that folder")
    project.motion_path.unlink(missing_ok=True)  # of a draw that was left for the table
    write_samples(project.samples_path, samples)
    return samples


@exclusive
def train(
    project: Project,
    update: Update | None = None,
    executor: Executor | None = None,
    *,
    structure: str | None = None,
    teacher: ContactModel | None = None,
) -> list[Path]:
    """Train the preset's structures, or this one alone, and write a surrogate file for each; goes on from checkpoints.

    teacher: the user's own contact model that the samples come from, for `calibrate`. Raises ValueError for a structure
    that is not trained for this preset and scene, and for active rounds on samples of a user's own model."""
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
    """The command line that builds a project's surrogates from nothing, around cycle files; for a user's own model a
    line of Python. tolerances: options of a build to tolerances instead of a preset."""
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
    scene, motion = project.scene, read_motion(project).motion
    return draw_samples(scene, motion, path, settings=settings, executor=executor, models=models, progress=progress)


def worst_samples(model: LoadModel, samples: Samples, share: float) -> Samples:
    """The share of samples on which a model is worst, by max over loads |model - sample|/tolerance, as training rows;
    and all on which nothing touches: a load error of zero does not tell how near a false contact is."""
    tolerances = samples.scene.tolerances_of(model.load_names)
    errors = np.max(np.abs(model(samples.poses) - samples.loads(model.load_names)) / tolerances, axis=1)
    chosen = (samples.wrenches == 0.0).all(axis=(1, 2))
    chosen[np.argsort(-errors, kind="stable")[: round(share * len(samples))]] = True
    worst = samples.rows(chosen)
    return replace(worst, role=np.full(len(worst), TRAIN, dtype=np.uint8))
