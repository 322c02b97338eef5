"""Independent networks train side by side through any ``concurrent.futures.Executor``.

A worker reports its progress in a small JSON file beside its checkpoint, which the parent reads; that works across
threads, processes and machines that share a folder, and a lost file costs nothing but a line of progress.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Executor, Future, wait
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.workers import cancelled_if_left
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import Fit, check, fit, progress_text
from casadi_contact.networks.training.settings import TrainingSettings


class _Job(NamedTuple):
    """Arguments of `fit`; report: file of a worker's progress."""

    regression: Regression
    settings: TrainingSettings
    checkpoint: Path | None
    start: Network | None
    report: Path


def fit_all(
    regressions: Sequence[Regression],
    settings: Mapping[str, TrainingSettings],
    executor: Executor | None = None,
    checkpoint_folder: Path | None = None,
    progress: Update | None = None,
    starts: Mapping[str, Network] | None = None,
) -> dict[str, Fit]:
    """Fit every regression, the one with the largest budget first; returns the fits by name, in given order.

    settings: by the regression's name. executor: None fits one after the other here.
    checkpoint_folder: a file ``<name>.npz`` for each fit; a later call goes on from these, after Ctrl-C too.
    starts: networks to go on from instead of random weights, by the regression's name.
    progress: called here as by `fit`; for a fit that a worker has ended, at once, with the work done as the budget.

    Raises ValueError for what `fit` refuses; the fits still waiting are then cancelled, those running go on in their
    workers until the executor is shut down.
    """
    for regression in regressions:
        check(regression)
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as temporary:
        folder = Path(temporary if checkpoint_folder is None else checkpoint_folder)
        folder.mkdir(parents=True, exist_ok=True)
        jobs = {}
        for regression in sorted(regressions, key=lambda r: -settings[r.name].max_gflop):
            name, stem = regression.name, quote(regression.name, safe="")
            checkpoint = None if checkpoint_folder is None else folder / f"{stem}.npz"
            start = (starts or {}).get(name)
            jobs[name] = _Job(regression, settings[name], checkpoint, start, folder / f"{stem}.progress.json")
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


def _fit_and_report(job: _Job, period_s: float = 0.5) -> Fit:
    """In the worker: fit, and write the progress file now and then; it is removed at the end."""
    last = -period_s

    def report(*line: object) -> None:
        nonlocal last
        if time.monotonic() - last >= period_s:
            last = time.monotonic()
            with suppress(OSError), replacing(job.report) as beside:  # a full disc must not end hours of training
                beside.write_text(json.dumps(line), "utf-8")

    try:
        return fit(job.regression, job.settings, job.checkpoint, report, job.start)
    finally:
        with suppress(OSError):
            job.report.unlink(missing_ok=True)


def _collect(futures: dict[str, Future[Fit]], jobs: dict[str, _Job], progress: Update | None) -> dict[str, Fit]:
    waiting = set(futures.values())
    reported: dict[str, object] = {}
    while waiting:
        done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_EXCEPTION)
        for name, future in futures.items():
            if future in done:
                ended = future.result()
                if progress:
                    progress(name, ended.gflop, ended.gflop, progress_text(ended.network.hidden, ended.rms))
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
