"""Fit the networks of a surrogate side by side, and record how it was made."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from casadi_contact.conventions import Update, in_stage
from casadi_contact.dataset import DOMAINS, Samples
from casadi_contact.dataset.mirror import either_side
from casadi_contact.network import Network, PartsRegression, Regression, size_text
from casadi_contact.project.active import candidates, models_to_ask, worst_samples
from casadi_contact.project.presets import TOGETHER, Effort, effort_for
from casadi_contact.project.project import (
    Project,
    alone,
    cycle_files,
    surrogates_made,
)
from casadi_contact.project.training_record import gone_on, training_record
from casadi_contact.sampling import model_name_of, teacher_of
from casadi_contact.sampling.around import samples_around
from casadi_contact.sampling.chunk import WrenchModel
from casadi_contact.scenes import Scene
from casadi_contact.structures import STRUCTURES, Surrogate, with_trust
from casadi_contact.structures.info import budget_line
from casadi_contact.training import Fit, TrainingSettings, fit_all, fit_all_parts
from casadi_contact.training.growth import widen
from casadi_contact.workers import worker_pool

_log = logging.getLogger(__name__)
_AnyRegression = TypeVar("_AnyRegression", Regression, PartsRegression)


def _asked(regression: _AnyRegression, effort: Effort, weights: Mapping[int, float]) -> _AnyRegression:
    """A regression as an effort asks for it: its domains weighted, and the share of its tolerance wanted."""
    return replace(regression.weighted(weights), tolerance=effort.tolerance_share * regression.tolerance)


def _at_most(regression: Regression, rows: int | None, seed: int) -> Regression:
    """A random subset of a regression's rows (§3.5 fits a random subset of the samples)."""
    if rows is None or len(regression.targets) <= rows:
        return regression
    kept = np.sort(np.random.default_rng(seed).choice(len(regression.targets), rows, replace=False))
    return regression.of_rows(kept)


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
    device: str = "cpu",
    teacher: WrenchModel | None = None,
) -> list[Path]:
    """Train the preset's structures, or this one alone, on all cores, and write a surrogate file for each.

    device: a torch device trains networks of one shape in batches instead (`training.TrainingSettings`). teacher: the
    user's own contact model that the samples come from, for `with_trust`. Goes on from checkpoints where an earlier
    run stopped. Raises ValueError for a structure that the preset does not train or that cannot stand for the scene's
    loads, and for active rounds on samples of another model than the library's.
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
        efforts = project.preset.efforts[name]
        folder, path = project.training_folder(name), project.surrogate_path(name)
        with worker_pool(executor) as workers:
            surrogate = fit_surrogate(
                project, samples, name, efforts, folder, command, name, update, workers, made=made, device=device
            )
            surrogate = _active_rounds(project, samples, surrogate, folder, command, update, workers, device)
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
        made = "casadi_contact.tolerance.train_to_tolerance" if tolerances else f"cc.build({named}, model=...)"
        return f"{made} in Python, with a contact model of one's own"
    around = [word for path in cycles for word in ("--cycles", path)]
    return project.command("build", "--model", drawn_from, *around, *tolerances, preset=not tolerances)


def _active_rounds(
    project: Project,
    samples: Samples,
    surrogate: Surrogate,
    checkpoints: Path,
    command: str,
    update: Update | None,
    executor: Executor,
    device: str,
) -> Surrogate:
    """The surrogate trained on through those of the preset's active rounds that its structure takes part in."""
    name, learned = surrogate.structure, samples
    for number, chosen in enumerate(project.preset.active, start=1):
        if name not in chosen.efforts:
            continue
        title = f"{name}, round {number}"
        drawn = candidates(project, samples, number, chosen.times, in_stage(update, f"{title}: candidates"), executor)
        learned = learned.join_samples(worst_samples(surrogate, drawn, chosen.worst_share))
        folder, efforts = checkpoints / f"active-{number}", chosen.efforts[name]
        surrogate = fit_surrogate(
            project, learned, name, efforts, folder, command, title, update, executor, device=device, onward=surrogate
        )
    return surrogate


def moved_samples(samples: Samples, model: WrenchModel | None, update: Update | None = None) -> Samples | None:
    """`samples_around` on the model that the samples were evaluated on, None without one: a surrogate's trust is
    calibrated on them too. Of a user's own model, which may be slow, a third as many poses as there are samples."""
    if model is None:
        return None
    count = len(samples) // 3 if model_name_of(samples) is None else None
    return samples_around(samples, model, count=count, progress=in_stage(update, "poses around the samples"))


def fit_surrogate(
    project: Project,
    samples: Samples,
    structure: str,
    efforts: Mapping[str, Effort],
    checkpoints: Path,
    command: str,
    title: str,
    update: Update | None = None,
    executor: Executor | None = None,
    loads: Sequence[str] | None = None,
    made: Mapping[str, Surrogate] | None = None,
    device: str = "cpu",
    onward: Surrogate | None = None,
    seed: int = 0,
) -> Surrogate:
    """A surrogate of one structure, its networks fitted side by side, with a record of how it was made.

    efforts: by the start of a network's name (see `Preset`). checkpoints: folder that a later call goes on from.
    command: what a reader of the record runs to make it again. loads: fit only the networks that these need. Of a joint
    that is its own mirror image one side is fitted, on the samples of both. update is called as (title and network,
    Gflop used, Gflop allotted, remark). One logged warning names the networks that stopped because their budget was
    used up. made: surrogates of the same samples by structure, from which some structures train on
    (`Surrogate.starts`). device: as in `train`. onward: a surrogate whose networks go on from their weights, widened to
    the first size of their effort; a fit that stalls does not begin again from random ones. seed: of random weights.
    """
    kind, scene = STRUCTURES[structure], project.scene
    weights = {DOMAINS.index(name) + 1: weight for name, weight in project.preset.domain_weights.items()}
    posed, twins = _regressions_and_twins(kind, samples, scene, loads)
    asked = {regression.name: effort_for(efforts, regression.name) for regression in posed}
    first = {name: each.sizes[0] for name, each in asked.items()}
    if onward is None:
        starts = kind.starts(first, {structure: one.networks for structure, one in (made or {}).items()})
    else:
        starts = {name: _widened(onward.networks[name], hidden) for name, hidden in first.items()}
    kept = {} if onward is None else {name: starts[name] for name, each in asked.items() if each.gflop == 0.0}
    restarts = TrainingSettings.restarts if onward is None else 0
    settings = {
        name: TrainingSettings(each.sizes, each.activation, each.gflop, seed=seed, restarts=restarts, device=device)
        for name, each in asked.items()
        if name not in kept
    }
    regressions = [
        _at_most(_asked(one, asked[one.name], weights), asked[one.name].max_rows, seed=0)
        for one in posed
        if one.name not in kept
    ]
    progress = None if update is None else lambda name, *rest: update(f"{title} {name}", *rest)
    single = fit_all(regressions, settings, executor, checkpoints, progress, starts)
    if progress is not None:
        _tell_ends(single, progress)
    fits: dict[str, Any] = {**single}
    networks = kept | {name: fit.network for name, fit in single.items()}
    if TOGETHER in efforts and loads is None:
        effort = efforts[TOGETHER]
        together = TrainingSettings(max_gflop=effort.gflop, seed=seed)
        whole = [_asked(regression, effort, weights) for regression in kind(scene, networks).parts_regressions(samples)]
        of_patches = fit_all_parts(whole, together, networks, executor, checkpoints, progress)
        networks |= {name: network for fit in of_patches.values() for name, network in fit.networks.items()}
        fits |= of_patches
    networks |= {twin: kind.reflection(twin, networks[of], scene) for twin, of in twins.items()}
    if loads is not None:
        networks = {name: networks[name] for name in kind.networks_for(scene, loads)}
    record = training_record(project, samples, kind(scene, networks), fits, command, device)
    surrogate = kind(scene, networks, record if onward is None else gone_on(onward.record, record))
    if line := budget_line(surrogate.record):
        _log.warning("%s: %s", title, line)
    return surrogate


def _regressions_and_twins(
    kind: type[Surrogate], samples: Samples, scene: Scene, loads: Sequence[str] | None
) -> tuple[list[Regression], dict[str, str]]:
    """What is fitted for these loads (None: all of the scene's), and the networks that are mirror images of fitted
    ones, each with its original, which is fitted on the samples of both sides."""
    needed = None if loads is None else kind.networks_for(scene, loads)
    twins = {twin: of for twin, of in kind.twins(scene).items() if needed is None or twin in needed}
    posed = {regression.name: regression for regression in kind.regressions(either_side(samples) if twins else samples)}
    twins = {twin: of for twin, of in twins.items() if twin in posed and of in posed}  # one side alone may be asked for
    fitted = set(posed) - set(twins) if needed is None else {twins.get(name, name) for name in needed}
    return [regression for name, regression in posed.items() if name in fitted], twins


def _tell_ends(fits: Mapping[str, Fit], progress: Update) -> None:
    """How each fit ended."""
    for name, fit in fits.items():
        remark = f"{size_text(fit.hidden)} RMS {fit.rms:.3g} after {fit.gflop:.3g} Gflop, {fit.stop_reason}"
        progress(name, fit.gflop, fit.gflop, remark)


def _widened(network: Network, hidden: tuple[int, ...]) -> Network:
    return network if network.hidden == hidden else widen(network, hidden, seed=0)
