"""Independent networks train side by side through any ``concurrent.futures.Executor``.

Progress is read from the checkpoints of the workers; that works across threads, processes and machines that share a
folder.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Executor, Future, wait
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.containers import read_npz
from casadi_contact.core.workers import cancelled_if_left
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import Fit, check, fit, progress_text
from casadi_contact.networks.training.settings import TrainingSettings


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
        largest_first = sorted(regressions, key=lambda regression: -settings[regression.name].max_gflop)
        checkpoints = {r.name: folder / f"{quote(r.name, safe='')}.npz" for r in largest_first}
        jobs = {r.name: (r, settings[r.name], checkpoints[r.name], (starts or {}).get(r.name)) for r in largest_first}
        if executor is None:
            fits = {name: fit(*job, progress) for name, job in jobs.items()}
        else:
            futures = {name: executor.submit(fit, *job) for name, job in jobs.items()}
            with cancelled_if_left(executor, futures.values()):
                fits = _collect(futures, settings, checkpoints, progress)
    return {regression.name: fits[regression.name] for regression in regressions}


def _collect(
    futures: Mapping[str, Future[Fit]],
    settings: Mapping[str, TrainingSettings],
    checkpoints: Mapping[str, Path],
    progress: Update | None,
) -> dict[str, Fit]:
    """The fits when all have ended; meanwhile progress is told from the checkpoints that workers write."""
    waiting = set(futures.values())
    while waiting:
        done, waiting = wait(waiting, timeout=1.0, return_when=FIRST_EXCEPTION)
        for name, future in futures.items():
            if future in done:
                ended = future.result()
                if progress:
                    progress(name, ended.gflop, ended.gflop, progress_text(ended.network.hidden, ended.rms))
            elif progress and future in waiting:
                with suppress(OSError, ValueError, KeyError, IndexError):  # not written yet
                    saved, chosen = read_npz(checkpoints[name]), settings[name]
                    gflop, rms = (float(saved[f"history_{column}"][-1]) for column in ("gflop", "training_rms"))
                    text = progress_text(chosen.sizes[int(saved["level"])], rms)
                    progress(name, gflop, chosen.gflop_at_end(gflop, float(saved["cpu_s"])), text)
    return {name: future.result() for name, future in futures.items()}
