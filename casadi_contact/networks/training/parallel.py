"""Independent networks train side by side through any ``concurrent.futures.Executor``.

A worker reports its progress in a small JSON file beside its checkpoint, which the parent reads; that works across
threads, processes and machines that share a folder, and a lost file costs nothing but a line of progress.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Executor, Future, wait
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.workers import cancelled_if_left
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import Fit, check, fit
from casadi_contact.networks.training.settings import TrainingSettings

SettingsOf = Mapping[str, TrainingSettings] | Callable[[Regression], TrainingSettings]


class _Job(NamedTuple):
    """Arguments of `fit`; report: file of a worker's progress, written at most every period_s."""

    regression: Regression
    settings: TrainingSettings
    checkpoint: Path | None
    start: Network | None
    report: Path
    period_s: float = 0.5


def fit_all(
    regressions: Sequence[Regression],
    settings: SettingsOf,
    executor: Executor | None = None,
    checkpoint_folder: Path | None = None,
    progress: Update | None = None,
    starts: Mapping[str, Network] | None = None,
) -> dict[str, Fit]:
    """Fit every regression, the one with the largest budget first; returns the fits by name, in given order.

    settings: by the regression's name, or a function of the regression. executor: None fits one after the other here.
    checkpoint_folder: a file ``<name>.npz`` for each fit; a later call goes on from these, after Ctrl-C too.
    starts: networks to go on from instead of random weights, by the regression's name.
    progress: called here as by `fit`; for a fit that a worker has ended, at once, with the work done as the budget.

    Raises ValueError for duplicate names, missing settings, and for what `fit` refuses; the fits still waiting are
    then cancelled, those running go on in their workers until the executor is shut down.
    """
    chosen = _settings_by_name(regressions, settings)
    for regression in regressions:
        check(regression)
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as temporary:
        folder = Path(temporary if checkpoint_folder is None else checkpoint_folder)
        folder.mkdir(parents=True, exist_ok=True)
        jobs = {}
        for regression in sorted(regressions, key=lambda r: -chosen[r.name].max_gflop):
            name, stem = regression.name, quote(regression.name, safe="")
            checkpoint = None if checkpoint_folder is None else folder / f"{stem}.npz"
            start = (starts or {}).get(name)
            jobs[name] = _Job(regression, chosen[name], checkpoint, start, folder / f"{stem}.progress.json")
        if executor is None:
            fits = {
                name: fit(job.regression, job.settings, job.checkpoint, progress, job.start)
                for name, job in jobs.items()
            }
        else:
            futures = {name: executor.submit(_fit_and_report, job) for name, job in jobs.items()}
            with cancelled_if_left(executor, futures.values()):
                fits = _collect(futures, jobs, progress)
    return {regression.name: fits[regression.name] for regression in regressions}


def _settings_by_name(regressions: Sequence[Regression], settings: SettingsOf) -> dict[str, TrainingSettings]:
    names = [regression.name for regression in regressions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"regressions share the name {twice[0]!r}, expected names that differ")
    if callable(settings):
        return {regression.name: settings(regression) for regression in regressions}
    missing = [name for name in names if name not in settings]
    if missing:
        raise ValueError(f"no settings for regression {missing[0]!r}, expected one for each of {', '.join(names)}")
    return {name: settings[name] for name in names}


def _fit_and_report(job: _Job) -> Fit:
    """In the worker: fit, and write the progress file now and then."""
    with _reporting(job.report, job.period_s) as report:
        return fit(job.regression, job.settings, job.checkpoint, report, job.start)


@contextmanager
def _reporting(path: Path, period_s: float) -> Iterator[Update]:
    """An `Update` that writes the progress file, which is removed at the end."""
    last = -period_s

    def report(name: str, used: float, allotted: float, remark: str) -> None:
        nonlocal last
        if time.monotonic() - last < period_s:
            return
        last = time.monotonic()
        with suppress(OSError), replacing(path) as beside:  # a full disc must not end hours of training
            beside.write_text(json.dumps([name, used, allotted, remark]), "utf-8")

    try:
        yield report
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def _collect(futures: dict[str, Future[Fit]], jobs: dict[str, _Job], progress: Update | None) -> dict[str, Fit]:
    waiting = set(futures.values())
    reported: dict[str, object] = {}
    while waiting:
        done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_EXCEPTION)
        for name, future in futures.items():
            if future in done:
                ended = future.result()
                if progress:
                    progress(name, ended.gflop, ended.gflop, ended.progress_text)
        for name, job in jobs.items():
            line = _last_report(job.report)
            if progress and line and reported.get(name) != line:
                reported[name] = line
                progress(*line)
    return {name: future.result() for name, future in futures.items()}


def _last_report(path: Path) -> tuple[str, float, float, str] | None:
    try:
        name, used, allotted, remark = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return name, used, allotted, remark
