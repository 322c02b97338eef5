"""Fit the networks of a surrogate side by side, and record how it was made."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Update
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training.fit import Fit
from casadi_contact.networks.training.parallel import fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.weights import widen
from casadi_contact.samples.mirror import either_side
from casadi_contact.samples.samples import DOMAINS, Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.info import budget_line
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.presets import Effort, effort_for
from casadi_contact.workflow.project import Project
from casadi_contact.workflow.training_record import gone_on, training_record

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Fitting:
    """How a surrogate is to be fitted.

    structure: key of `STRUCTURES`. efforts: by the start of a network's name (see `Preset`). checkpoints: folder that a
    later call goes on from. command: what a reader of the record runs to make it again. title: in progress, the
    structure if empty. loads: fit only the networks that these need. seed: of random weights. kept: networks by name
    that are taken as they are.
    """

    structure: str
    efforts: Mapping[str, Effort]
    checkpoints: Path
    command: str
    title: str = ""
    loads: Sequence[str] | None = None
    seed: int = 0
    kept: Mapping[str, Network] = field(default_factory=dict)


def fit_surrogate(
    project: Project,
    samples: Samples,
    fitting: Fitting,
    update: Update | None = None,
    executor: Executor | None = None,
    *,
    onward: Surrogate | None = None,
) -> Surrogate:
    """A surrogate of one structure, its networks fitted side by side, with a record of how it was made.

    Of a joint that is its own mirror image one side is fitted, on the samples of both. update is called as (title and
    network, Gflop used, Gflop allotted, remark). One logged warning names the networks that stopped because their
    budget was used up, where all are fitted: sizes that are only tried may be too small. onward: a surrogate
    whose networks go on from their weights, widened to the first size of their effort; a fit that stalls does not begin
    again from random ones.
    """
    kind, scene, title = STRUCTURES[fitting.structure], project.scene, fitting.title or fitting.structure
    weights = {DOMAINS.index(name) + 1: weight for name, weight in project.preset.domain_weights.items()}
    progress = None if update is None else lambda name, *rest: update(f"{title} {name}", *rest)
    posed, twins = _regressions_and_twins(kind, samples, scene, fitting.loads)
    names = [regression.name for regression in posed if regression.name not in fitting.kept]
    asked = {name: effort_for(fitting.efforts, name) for name in names}
    starts, kept = {}, dict(fitting.kept)
    if onward is not None:
        starts = {name: _widened(onward.networks[name], each.sizes[0]) for name, each in asked.items()}
        kept |= {name: starts[name] for name, each in asked.items() if each.gflop == 0.0}
    restarts = TrainingSettings.restarts if onward is None else 0
    settings = {
        name: TrainingSettings(each.sizes, each.activation, each.gflop, seed=fitting.seed, restarts=restarts)
        for name, each in asked.items()
        if name not in kept
    }
    regressions = [
        _at_most(_asked(one, asked[one.name], weights), asked[one.name].max_rows, seed=0)
        for one in posed
        if one.name not in kept
    ]
    fits = fit_all(regressions, settings, executor, fitting.checkpoints, progress, starts)
    if progress is not None:
        _tell_ends(fits, progress)
    networks = kept | {name: fit.network for name, fit in fits.items()}
    networks |= {twin: kind.reflection(twin, networks[of], scene) for twin, of in twins.items()}
    if fitting.loads is not None:
        networks = {name: networks[name] for name in kind.networks_for(scene, fitting.loads)}
    record = training_record(project, samples, kind(scene, networks), fits, fitting.command)
    surrogate = kind(scene, networks, record if onward is None else gone_on(onward.record, record))
    if not fitting.kept and (line := budget_line(surrogate.record)):
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


def _asked(regression: Regression, effort: Effort, weights: Mapping[int, float]) -> Regression:
    """A regression as an effort asks for it: its domains weighted, and the share of its tolerance wanted."""
    return replace(regression.weighted(weights), tolerance=effort.tolerance_share * regression.tolerance)


def _at_most(regression: Regression, rows: int | None, seed: int) -> Regression:
    """A random subset of a regression's rows (§3.5 fits a random subset of the samples)."""
    if rows is None or len(regression.targets) <= rows:
        return regression
    kept = np.sort(np.random.default_rng(seed).choice(len(regression.targets), rows, replace=False))
    return regression.of_rows(kept)
