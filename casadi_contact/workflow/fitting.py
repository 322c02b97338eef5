"""Fit the networks of a surrogate side by side, and record how it was made."""

import logging
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Update
from casadi_contact.core.machine import machine_record
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training.fit import Fit, fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.weights import widen
from casadi_contact.samples.samples import DOMAINS, Samples, domain_errors, either_side, samples_record
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.info import budget_line
from casadi_contact.surrogate.load import STRUCTURES
from casadi_contact.workflow.presets import Effort, effort_for
from casadi_contact.workflow.project import Project

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Fitting:
    """How a surrogate is fitted: structure, a key of `STRUCTURES`; efforts by the start of a network's name (see
    `Preset`); the folder of checkpoints; the command that makes it again; and its title in progress."""

    structure: str
    efforts: Mapping[str, Effort]
    checkpoints: Path
    command: str
    title: str = ""


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

    Of a joint that is its own mirror image one side is fitted, on the samples of both. A logged warning names the
    networks whose budget was used up. onward: a surrogate whose networks go on from their weights, widened to the first
    size of their effort; a fit that stalls does not begin again from random ones."""
    kind, scene, title = STRUCTURES[fitting.structure], project.scene, fitting.title or fitting.structure
    weights = {DOMAINS.index(name) + 1: weight for name, weight in project.preset.domain_weights.items()}
    progress = None if update is None else lambda name, *rest: update(f"{title} {name}", *rest)
    twins = kind.twins(scene)
    posed = {regression.name: regression for regression in kind.regressions(either_side(samples) if twins else samples)}
    twins = {twin: of for twin, of in twins.items() if twin in posed and of in posed}  # one side alone may be asked for
    regressions = [regression for name, regression in posed.items() if name not in twins]
    efforts = {regression.name: effort_for(fitting.efforts, regression.name) for regression in regressions}
    starts, before = dict[str, Network](), {} if onward is None else onward.networks
    for name, effort in efforts.items() if before else ():
        start = before[name]
        starts[name] = start if start.hidden == effort.sizes[0] else widen(start, effort.sizes[0], seed=0)
    networks = {name: start for name, start in starts.items() if efforts[name].gflop == 0.0}
    settings, chosen = {}, []
    for regression in regressions:
        if (name := regression.name) not in networks:
            it, more = efforts[name], {"restarts": 0} if before else {}
            settings[name] = TrainingSettings(it.sizes, it.activation, it.gflop, max_cpu_s=it.cpu_s, **more)
            tolerance = it.tolerance_share * regression.tolerance
            chosen.append(_random_rows(replace(regression.weighted(weights), tolerance=tolerance), it.max_rows))
    fits = fit_all(chosen, settings, executor, fitting.checkpoints, progress, starts)
    if progress is not None:
        for name, fit in fits.items():
            remark = f"{size_text(fit.network.hidden)} RMS {fit.rms:.3g} after {fit.gflop:.3g} Gflop, {fit.stop_reason}"
            progress(name, fit.gflop, fit.gflop, remark)
    networks |= {name: fit.network for name, fit in fits.items()}
    networks |= {twin: kind.reflection(twin, networks[of], scene) for twin, of in twins.items()}
    record = {  # its keys: `casadi_contact.surrogate.info`
        **samples_record(samples),
        **fits_record(fits),
        "test_errors": domain_errors(kind(scene, networks), samples),
        "command": fitting.command,
        "machine": machine_record(),
    }
    surrogate = kind(scene, networks, record if onward is None else continued_record(onward.record, record))
    if line := budget_line(surrogate.record):
        _log.warning("%s: %s", title, line)
    return surrogate


def _random_rows(regression: Regression, rows: int | None) -> Regression:
    """A random subset of a regression's rows, as in [EF15 §3.5]."""
    if rows is None or len(regression.targets) <= rows:
        return regression
    return regression.of_rows(np.sort(np.random.default_rng(0).choice(len(regression.targets), rows, replace=False)))


def fits_record(fits: Mapping[str, Fit]) -> dict[str, Any]:
    """What the record says of the fits alone."""
    return {
        "training_errors": {name: fit.rms for name, fit in fits.items()},
        "stop_reasons": {name: fit.stop_reason for name, fit in fits.items()},
        "gflop": {name: round(fit.gflop, 1) for name, fit in fits.items()},
        "seconds": {name: round(fit.cpu_s, 1) for name, fit in fits.items()},
    }


def summed_work(before: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """Work and time of both records, by network."""
    both = {}
    for key in ("gflop", "seconds"):
        spent, later = before.get(key, {}), record[key]
        both[key] = {name: round(spent.get(name, 0.0) + later.get(name, 0.0), 1) for name in {**spent, **later}}
    return both


def continued_record(before: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """The record of networks trained on from others: work and time are summed, the share of rejected samples is that of
    `before` (a round keeps only the worst of what it draws), all else is the later's."""
    added = sum(record["samples"].values()) - sum(before["samples"].values())
    of_both = {"dropped": before["dropped"], "active": [*before.get("active", []), added]}
    return {**record, **summed_work(before, record), **of_both}
