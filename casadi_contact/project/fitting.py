"""Fit the networks of a surrogate side by side, and record how it was made."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from casadi_contact.dataset import DOMAINS, Samples
from casadi_contact.dataset.errors import domain_errors
from casadi_contact.dataset.mirror import either_side
from casadi_contact.machine import machine_record
from casadi_contact.network import Network, PartsRegression, Regression
from casadi_contact.project.active import candidates, models_to_ask, worst_samples
from casadi_contact.project.presets import TOGETHER, Effort, effort_for
from casadi_contact.project.project import (
    Project,
    Update,
    alone,
    cycle_files,
    has_motion,
    in_stage,
    read_motion,
    surrogates_made,
)
from casadi_contact.sampling import model_name_of, teacher_of
from casadi_contact.sampling.around import samples_around
from casadi_contact.sampling.chunk import WrenchModel
from casadi_contact.structures import STRUCTURES, Surrogate, with_trust
from casadi_contact.structures.info import budget_line, samples_record
from casadi_contact.training import TrainingSettings, fit_all, fit_all_parts
from casadi_contact.training.growth import widen
from casadi_contact.workers import worker_pool

_log = logging.getLogger(__name__)
_COURSE_POINTS = 60  # of a fit that the record keeps


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
    command = build_command(project, samples)
    samples = replace(samples, scene=project.scene)  # its tolerances are those of now
    paths, made = [], surrogates_made(project)
    for name in structures if structure is None else [structure]:
        efforts = project.preset.efforts[name]
        folder, path = project.folder / "training" / name, project.surrogate_path(name)
        with worker_pool(executor) as workers:
            surrogate = fit_surrogate(
                project, samples, name, efforts, folder, command, name, update, workers, made=made, device=device
            )
            surrogate = _active_rounds(project, samples, surrogate, folder, command, update, workers, device)
        made[name] = with_trust(surrogate, samples, around, model, in_stage(update, f"{name}: poses over the range"))
        made[name].save(path)
        paths.append(path)
    return paths


def build_command(project: Project, samples: Samples, *tolerances: str) -> str:
    """What builds a project's surrogates from nothing: a command line, a line of Python for a model of one's own.

    tolerances: the options of a build to them instead of a preset.
    """
    if "table" in samples.provenance:
        return project.command("build", "--table", samples.provenance["table"])
    drawn_from = model_name_of(samples)
    if drawn_from is None:
        named = f"{project.given or project.scene.name!r}, {project.preset_name!r}"
        made = "casadi_contact.tolerance.train_to_tolerance" if tolerances else f"cc.build({named}, model=...)"
        return f"{made} in Python, with a contact model of one's own"
    cycles = [word for path in cycle_files(project) for word in ("--cycles", path)]
    return project.command("build", "--model", drawn_from, *cycles, *tolerances, preset=not tolerances)


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
    kind = STRUCTURES[structure]
    needed = None if loads is None else kind.networks_for(project.scene, loads)
    twins = {twin: of for twin, of in kind.twins(project.scene).items() if needed is None or twin in needed}
    posed = {regression.name: regression for regression in kind.regressions(either_side(samples) if twins else samples)}
    twins = {twin: of for twin, of in twins.items() if twin in posed and of in posed}  # one side alone may be asked for
    fitted = set(posed) - set(twins) if needed is None else {twins.get(name, name) for name in needed}
    weights = {DOMAINS.index(name) + 1: weight for name, weight in project.preset.domain_weights.items()}
    regressions, settings = [], {}
    for regression in posed.values():
        if regression.name not in fitted:
            continue
        effort = effort_for(efforts, regression.name)
        regressions.append(_at_most(_asked(regression, effort, weights), effort.max_rows, seed=0))
        settings[regression.name] = TrainingSettings(
            sizes=effort.sizes,
            activation=effort.activation,
            max_gflop=effort.gflop,
            seed=seed,
            restarts=TrainingSettings.restarts if onward is None else 0,
            device=device,
        )

    def progress(name: str, used: float, allotted: float, rms: float, hidden: Any) -> None:
        if update is not None:
            update(f"{title} {name}", used, allotted, f"Gflop, {size_text(hidden)} RMS {rms:.3g}")

    first = {name: chosen.sizes[0] for name, chosen in settings.items()}
    if onward is None:
        starts = kind.starts(first, {structure: one.networks for structure, one in (made or {}).items()})
    else:
        starts = {name: _widened(onward.networks[name], hidden) for name, hidden in first.items()}
    fits: dict[str, Any] = {**fit_all(regressions, settings, executor, checkpoints, progress, starts)}
    for name, fit in fits.items():
        if update is not None:
            remark = f"{size_text(fit.hidden)} RMS {fit.rms:.3g} after {fit.gflop:.3g} Gflop, {fit.stop_reason}"
            update(f"{title} {name}", fit.gflop, fit.gflop, remark)
    networks = {name: fit.network for name, fit in fits.items()}
    if TOGETHER in efforts and loads is None:
        effort = efforts[TOGETHER]
        together = TrainingSettings(max_gflop=effort.gflop, seed=seed)
        whole = [_asked(regression, effort, weights) for regression in kind.parts_regressions(samples)]
        of_patches = fit_all_parts(whole, together, networks, executor, checkpoints, progress)
        networks |= {name: network for fit in of_patches.values() for name, network in fit.networks.items()}
        fits |= of_patches
    networks |= {twin: kind.reflection(twin, networks[of], project.scene) for twin, of in twins.items()}
    if needed is not None:
        networks = {name: networks[name] for name in needed}
    bare = kind(project.scene, networks)
    record = _record(project, samples, bare, fits, command, device)
    surrogate = kind(project.scene, networks, record if onward is None else _gone_on(onward.record, record))
    if line := budget_line(surrogate.record):
        _log.warning("%s: %s", title, line)
    return surrogate


def _widened(network: Network, hidden: tuple[int, ...]) -> Network:
    return network if network.hidden == hidden else widen(network, hidden, seed=0)


def _gone_on(before: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """The record of networks that went on from others: work and time are those of both, dropped shares the former's,
    since of what a round draws only the worst is kept; all else is the later's."""
    both = {
        key: {name: round(spent + before[key].get(name, 0.0), 1) for name, spent in record[key].items()}
        for key in ("gflop", "seconds")
    }
    added = sum(record["samples"].values()) - sum(before["samples"].values())
    return {**record, **both, "dropped": before["dropped"], "active": [*before.get("active", []), added]}


def size_text(hidden: Sequence[int]) -> str:
    """Neurons per hidden layer as people write them: "12-12"."""
    return "-".join(map(str, hidden))


def _course(history: Mapping[str, Any]) -> dict[str, list[float]]:
    """Work done [Gflop] and RMS of the fit at up to `_COURSE_POINTS` of its iterations, evenly spaced in log work."""
    gflop, rms = history["gflop"], history["training_rms"]
    begun = np.flatnonzero(gflop > 0.0)
    if not len(begun):
        return {"gflop": [], "rms": []}
    wanted = np.geomspace(gflop[begun[0]], gflop[-1], _COURSE_POINTS)
    chosen = np.unique(np.minimum(np.searchsorted(gflop, wanted), len(gflop) - 1))
    return {"gflop": [float(f"{x:.4g}") for x in gflop[chosen]], "rms": [float(f"{x:.4g}") for x in rms[chosen]]}


def _record(
    project: Project, samples: Samples, surrogate: Surrogate, fits: dict[str, Any], command: str, device: str
) -> dict[str, Any]:
    """What the surrogate's file says of how it was made (see `surrogate.info`)."""
    odd = samples.provenance.get("odd_rows")
    return {
        **samples_record(samples),
        **({} if odd is None else {"odd_rows": odd}),
        "training_errors": {name: fit.rms for name, fit in fits.items()},
        "test_errors": domain_errors(surrogate, samples),
        "command": command,
        "reference_cycles": read_motion(project)[1] if has_motion(project) else [],
        "stop_reasons": {name: fit.stop_reason for name, fit in fits.items()},
        "gflop": {name: round(fit.gflop, 1) for name, fit in fits.items()},
        "convergence": {name: _course(fit.history) for name, fit in fits.items()},
        "seconds": {name: round(fit.cpu_s, 1) for name, fit in fits.items()},
        "machine": {**machine_record(), **({} if device == "cpu" else {"device": f"{device}, untested on a GPU"})},
    }
