"""Fit a network to a regression: grow, restart, stop, and go on from where an earlier run ended; and several networks
side by side, through any ``concurrent.futures.Executor``.

Its state lies in one .npz file, the checkpoint. One that is damaged, or belongs to other data or settings, is refused,
because it may be hours of somebody's work that must not be overwritten. The progress of workers is read from their
checkpoints, which works across threads, processes and machines that share a folder.
"""

import hashlib
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Executor, Future, wait
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from threadpoolctl import threadpool_limits

from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.core.workers import cancelled_if_left
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.trainer import Trainer


@dataclass(frozen=True)
class Fit:
    """A fitted network, and how the fit went.

    rms: root-mean-square weighted residual on training rows, in the unit of the tolerance. history: training_rms,
    validation_error (`typical_error`), gflop and size (index into the settings' sizes), one entry an iteration.
    stop_reason: see `settings`. gflop: work done. cpu_s: CPU seconds of the thread that fitted; both count interrupted
    runs too.
    """

    network: Network
    history: dict[str, Array]
    stop_reason: str
    rms: float
    gflop: float
    cpu_s: float


def progress_text(hidden: tuple[int, ...], rms: float) -> str:
    """What an `Update` says beside the work of a fit: its unit, hidden layers and training RMS."""
    return f"Gflop, {size_text(hidden)} RMS {rms:.3g}"


def fit(
    regression: Regression,
    settings: TrainingSettings | None = None,
    checkpoint: Path | None = None,
    start: Network | None = None,
    progress: Update | None = None,
) -> Fit:
    """Fit a network within the settings' limits; the best found is returned, whatever the reason to stop.

    start: a network to go on from instead of random weights, of the settings' first size and activation. progress: is
    called after each iteration with the regression's name, Gflop used, Gflop allotted, and `progress_text`.

    With a ``checkpoint`` path the state is written there every ``checkpoint_every_s``, and on Ctrl-C in this process
    (workers are ended at once); a later call with the same regression and settings goes on from it (its budget too),
    or returns a finished fit at once. Higher limits than before continue a fit that those had ended.

    Raises ValueError for data that are not finite, and for a checkpoint that is damaged or of other data.
    """
    settings = settings or TrainingSettings()
    identity = _identity(regression, settings, start)
    with threadpool_limits(1):  # keeps weights reproducible
        trainer = _begun(regression, settings, start, checkpoint, identity)
        content, written = trainer.content(), time.monotonic()

        def write() -> None:
            if checkpoint:
                checkpoint.parent.mkdir(parents=True, exist_ok=True)
                write_npz(checkpoint, **identity, **content)

        try:
            while not trainer.stop_reason:
                trainer.iterate()
                content = trainer.content()
                if time.monotonic() - written >= settings.checkpoint_every_s:
                    write()
                    written = time.monotonic()
                if progress:
                    remark = progress_text(settings.sizes[trainer.level], trainer.training_rms)
                    progress(
                        regression.name, trainer.gflop, settings.gflop_at_end(trainer.gflop, trainer.cpu_s), remark
                    )
        finally:  # the last whole iteration, on Ctrl-C too
            write()
        network = trainer.best_network()
        rms = float(np.sqrt(regression.squares(network)[~regression.validation].mean()))
        history = {name: np.array(column) for name, column in trainer.history.items()}
        return Fit(network, history, trainer.stop_reason, rms, trainer.gflop, trainer.cpu_s)


def _identity(r: Regression, settings: TrainingSettings, start: Network | None) -> dict[str, Any]:
    """What a checkpoint is of. digest: SHA-256 of the settings, name and all data but floating-point numbers; sums
    (2·arrays,) of these, which processors round differently: Σ|a| of each array, and Σw·a with irregular weights
    |w| ≤ 1/2. More work or iterations continue a fit; saving does not change what is fitted.
    """
    chosen = asdict(settings)
    for key in ("max_gflop", "max_iterations", "max_cpu_s", "checkpoint_every_s"):
        del chosen[key]
    digest = hashlib.sha256(json.dumps([r.name, chosen], sort_keys=True).encode())
    arrays: list[Any] = [r.inputs, r.targets, r.weights, r.validation, np.asarray(r.false_load, float), r.tolerance]
    if r.domain is not None:
        arrays.append(r.domain)
    if start is not None:
        arrays += [start.input_shift, start.input_scale, start.output_scale, *start.weights, *start.biases]
    sums: list[float] = []
    for array in map(np.ascontiguousarray, arrays):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        if array.dtype.kind == "f":
            weights = np.arange(array.size) * (0.5 * (np.sqrt(5.0) - 1.0)) % 1.0 - 0.5
            sums += float(np.abs(array).sum()), float(array.ravel() @ weights)
        else:
            digest.update(array.data)
    return {"digest": digest.hexdigest(), "sums": np.array(sums)}


def _begun(
    regression: Regression,
    settings: TrainingSettings,
    start: Network | None,
    checkpoint: Path | None,
    identity: dict[str, Any],
) -> Trainer:
    """The fit as its checkpoint left it; a new one where there is none."""
    if checkpoint is None or not checkpoint.exists():
        return Trainer(regression, settings, None, start)
    saved = read_npz(checkpoint)
    digest, sums, expected = str(saved.get("digest")), saved.get("sums", np.empty(0)), identity["sums"]
    same = digest == identity["digest"] and (sums.shape, sums.dtype) == (expected.shape, expected.dtype)
    if not same or not (np.abs(sums - expected) <= 1e-9 * np.repeat(expected[::2], 2)).all():  # up to rounding
        raise ValueError(f"checkpoint {checkpoint} belongs to other data or settings: delete it, or move the folder")
    return Trainer(regression, settings, saved, start)


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

    Raises ValueError as `fit` does; the fits still waiting are then cancelled, those running go on in their
    workers until the executor is shut down.
    """
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
    """Wait for all fits; meanwhile report progress from the checkpoints that the workers write."""
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
