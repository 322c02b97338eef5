"""Independent networks train side by side through any ``concurrent.futures.Executor``.

A worker tells how far it is by a small JSON file beside its checkpoint, which the parent reads; that works across
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
from casadi_contact.networks.training.fit import Fit, check, course_text, fit
from casadi_contact.networks.training.settings import TrainingSettings

_TELL_EVERY_S = 0.5

SettingsOf = Mapping[str, TrainingSettings] | Callable[[Regression], TrainingSettings]


class _Job(NamedTuple):
    """What `fit` is given, but for progress."""

    regression: Regression
    settings: TrainingSettings
    checkpoint: Path | None
    start: Network | None


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
    progress: called here as by `fit`; of a fit that an executor has ended, at once, with what it used as what was
    allotted.

    Raises ValueError for duplicate names, missing settings, and for what `fit` refuses; the fits
    still waiting are then cancelled, those running go on in their workers until the executor is shut down.
    """
    chosen, given = _settings_by_name(regressions, settings), starts or {}
    for regression in regressions:
        check(regression)
    order = sorted(regressions, key=lambda r: -chosen[r.name].max_gflop)
    with _folder_for(checkpoint_folder) as folder:
        checkpoints = {r.name: None if checkpoint_folder is None else _beside(folder, r.name, "npz") for r in order}
        jobs = {r.name: _Job(r, chosen[r.name], checkpoints[r.name], given.get(r.name)) for r in order}
        fits = _run(jobs, executor, folder, progress)
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


def _beside(folder: Path, name: str, ending: str) -> Path:
    return folder / f"{quote(name, safe='')}.{ending}"


@contextmanager
def _folder_for(checkpoint_folder: Path | None) -> Iterator[Path]:
    """Where checkpoints and progress files lie: a folder that is gone at the end, where none is given."""
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as temporary:
        folder = Path(temporary if checkpoint_folder is None else checkpoint_folder)
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


def _run(
    jobs: Mapping[str, _Job],
    executor: Executor | None,
    folder: Path,
    progress: Update | None,
) -> dict[str, Fit]:
    """`fit` of every job by its name: one after the other here, or side by side in the workers."""
    if executor is None:
        return {
            name: fit(job.regression, job.settings, job.checkpoint, progress, job.start) for name, job in jobs.items()
        }
    reports = {name: _beside(folder, name, "progress.json") for name in jobs}
    futures = {name: executor.submit(_fit_and_tell, reports[name], job) for name, job in jobs.items()}
    with cancelled_if_left(executor, futures.values()):
        return _collect(futures, reports, progress)


def _fit_and_tell(report: Path, job: _Job) -> Fit:
    """In the worker: fit, and write the progress file now and then."""
    with _telling(report) as tell:
        return fit(job.regression, job.settings, job.checkpoint, tell, job.start)


@contextmanager
def _telling(report: Path) -> Iterator[Update]:
    """What writes the progress file now and then, which is gone at the end."""
    told = -_TELL_EVERY_S

    def tell(name: str, used: float, allotted: float, remark: str) -> None:
        nonlocal told
        if time.monotonic() - told < _TELL_EVERY_S:
            return
        told = time.monotonic()
        # Progress is a courtesy: a full or unreachable disc must not end hours of training.
        with suppress(OSError), replacing(report) as beside:
            beside.write_text(json.dumps([name, used, allotted, remark]), "utf-8")

    try:
        yield tell
    finally:
        with suppress(OSError):
            report.unlink(missing_ok=True)


def _collect(futures: dict[str, Future[Fit]], reports: dict[str, Path], progress: Update | None) -> dict[str, Fit]:
    waiting = set(futures.values())
    told: dict[str, object] = {}
    while waiting:
        done, waiting = wait(waiting, timeout=_TELL_EVERY_S, return_when=FIRST_EXCEPTION)
        for name, future in futures.items():
            if future in done:
                ended = future.result()
                if progress:
                    progress(name, ended.gflop, ended.gflop, course_text(ended.hidden, ended.rms))
        for name, report in reports.items():
            line = _last_report(report)
            if progress and line and told.get(name) != line:
                told[name] = line
                progress(*line)
    return {name: future.result() for name, future in futures.items()}


def _last_report(report: Path) -> tuple[str, float, float, str] | None:
    try:
        name, used, allotted, remark = json.loads(report.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return name, used, allotted, remark
