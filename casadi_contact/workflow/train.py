"""Train a project's surrogates: each structure of its preset, its active rounds, and the command that makes them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from casadi_contact.core.conventions import Update, in_stage
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.models import model_name_of, teacher_of
from casadi_contact.samples.perturbed import perturbed_samples
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.active import candidates, models_to_ask, worst_samples
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.project import Project, alone, cycle_files, surrogates_made


def structures_for_scene(project: Project) -> list[str]:
    """The preset's structures that can stand for the scene's loads."""
    return [name for name in project.preset.efforts if STRUCTURES[name].fits(project.scene)]


@alone
def train(
    project: Project,
    update: Update | None = None,
    executor: Executor | None = None,
    *,
    structure: str | None = None,
    teacher: WrenchModel | None = None,
) -> list[Path]:
    """Train the preset's structures, or this one alone, on all cores, and write a surrogate file for each.

    teacher: the user's own contact model that the samples come from, for `with_trust`. Goes on from checkpoints where
    an earlier run stopped. Raises ValueError for a structure that the preset does not train or that cannot stand for
    the scene's loads, and for active rounds on samples of another model than the library's.
    """
    structures = structures_for_scene(project)
    if structure is not None and structure not in structures:
        raise ValueError(
            f"structure {structure!r} is not trained for scene {project.scene.name} by preset {project.preset_name}, "
            f"expected one of {', '.join(structures)}"
        )
    samples = project.samples()
    if project.preset.active:
        models_to_ask(project, samples)  # refused here, not after hours of training
    model = teacher_of(samples) if teacher is None else teacher
    around = moved_samples(samples, model, update)
    command = build_command(project, samples, cycle_files(project))
    samples = replace(samples, scene=project.scene)  # its tolerances are those of now
    paths, made = [], surrogates_made(project)
    for name in structures if structure is None else [structure]:
        path = project.surrogate_path(name)
        first = Fitting(name, project.preset.efforts[name], project.training_folder(name), command)
        with worker_pool(executor) as workers:
            surrogate = fit_surrogate(project, samples, first, update, workers)
            surrogate = _active_rounds(project, samples, surrogate, first, update, workers)
        made[name] = with_trust(surrogate, samples, around, model, update)
        made[name].save(path)
        paths.append(path)
    return paths


def build_command(project: Project, samples: Samples, cycles: Sequence[str], *tolerances: str) -> str:
    """What builds a project's surrogates from nothing: a command line, a line of Python for a model of one's own.

    cycles: files that the samples were drawn around; tolerances: the options of a build to them instead of a preset.
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
    project: Project,
    samples: Samples,
    surrogate: Surrogate,
    first: Fitting,
    update: Update | None,
    executor: Executor,
) -> Surrogate:
    """The surrogate trained on through those of the preset's active rounds that its structure takes part in; first: how
    it was fitted before them."""
    name, learned = first.structure, samples
    for number, chosen in enumerate(project.preset.active, start=1):
        if name not in chosen.efforts:
            continue
        title = f"{name}, round {number}"
        telling = in_stage(update, f"{title}: candidates")
        drawn = candidates(project, samples, number, chosen.times, telling, executor)
        learned = learned.join_samples(worst_samples(surrogate, drawn, chosen.worst_share))
        folder, efforts = first.checkpoints / f"active-{number}", chosen.efforts[name]
        further = replace(first, efforts=efforts, checkpoints=folder, title=title)
        surrogate = fit_surrogate(project, learned, further, update, executor, onward=surrogate)
    return surrogate


def moved_samples(samples: Samples, model: WrenchModel | None, update: Update | None = None) -> Samples | None:
    """`perturbed_samples` on the model that the samples were evaluated on, None without one: a surrogate's trust is
    calibrated on them too. Of a user's own model, which may be slow, a third as many poses as there are samples."""
    if model is None:
        return None
    count = len(samples) // 3 if model_name_of(samples) is None else None
    return perturbed_samples(samples, model, count=count, progress=in_stage(update, "poses around the samples"))
