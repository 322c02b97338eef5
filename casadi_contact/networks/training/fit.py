"""Fit one network to one regression: grow, restart, stop, and go on from where an earlier run ended."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from casadi_contact.core.conventions import Array, Update
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training import checkpoint as checkpoint_file
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.trainer import Trainer


@dataclass(frozen=True)
class Fit:
    """A fitted network, and how the fit went.

    rms, validation_rms: root-mean-square weighted residual on training and validation rows, in the unit of the
    tolerance, the latter NaN without validation rows. history: training_rms, validation_rms, gflop and size (index
    into the settings' sizes), one entry an iteration. stop_reason: see `stopping`. gflop: work done. cpu_s: CPU
    seconds of the thread that fitted; both count interrupted runs too.
    """

    network: Network
    history: dict[str, Array]
    stop_reason: str
    rms: float
    validation_rms: float
    gflop: float
    cpu_s: float

    @property
    def parameter_count(self) -> int:
        """Number of weights and biases."""
        return self.network.parameter_count

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons per hidden layer."""
        return self.network.hidden

    @property
    def progress_text(self) -> str:
        """Hidden layers and training RMS, for an `Update`."""
        return progress_text(self.hidden, self.rms)


def progress_text(hidden: tuple[int, ...], rms: float) -> str:
    """What an `Update` says beside the work of a fit: its unit, hidden layers and training RMS."""
    return f"Gflop, {size_text(hidden)} RMS {rms:.3g}"


def check(regression: Regression) -> None:
    """Raises ValueError, naming the regression, for data that cannot be fitted."""
    name, rows = regression.name, len(regression.inputs)
    if regression.inputs.ndim != 2 or regression.inputs.shape[1] < 1:
        raise ValueError(f"regression {name}: inputs has shape {regression.inputs.shape}, expected (n, k)")
    if np.ndim(regression.targets) > 1 and regression.outputs < 2:
        raise ValueError(
            f"regression {name}: targets have shape {np.shape(regression.targets)}, expected (n,) for one output"
        )
    per_row = (rows,) if np.ndim(regression.targets) == 1 else (rows, regression.outputs)
    shapes = {"targets": per_row, "weights": per_row, "validation": (rows,)}
    if regression.domain is not None:
        shapes["domain"] = (rows,)
    for column, expected in shapes.items():
        shape = np.shape(getattr(regression, column))
        if shape != expected:
            raise ValueError(f"regression {name}: {column} has shape {shape}, expected {expected} like the inputs")
    false_load = np.asarray(regression.false_load, dtype=float)
    if false_load.shape not in ((), per_row) or not (np.isfinite(false_load) & (false_load >= 0.0)).all():
        raise ValueError(f"regression {name}: expected false_load of 0 or more, one number or {per_row}")
    for column in ("inputs", "targets", "weights"):
        values = np.asarray(getattr(regression, column), dtype=float)
        bad = ~np.isfinite(values)
        if bad.any():
            raise ValueError(
                f"regression {name}: {column} holds {values[bad][0]} at row {np.argwhere(bad)[0][0]}, "
                "expected finite numbers"
            )
    kind = getattr(regression.validation, "dtype", type(regression.validation).__name__)
    if str(kind) != "bool":
        raise ValueError(f"regression {name}: validation is {kind}, expected an array of True and False")
    if (regression.weights < 0.0).any() or not (regression.weights[~regression.validation] > 0.0).any():
        raise ValueError(f"regression {name}: expected weights of 0 or more, and above 0 in some training row")
    if not regression.tolerance >= 0.0:
        raise ValueError(f"regression {name}: tolerance is {regression.tolerance!r}, expected 0 or more")


def fit(
    regression: Regression,
    settings: TrainingSettings | None = None,
    checkpoint: Path | None = None,
    progress: Update | None = None,
    start: Network | None = None,
) -> Fit:
    """Fit a network within the settings' limits; the best found is returned, whatever the reason to stop.

    start: a network to go on from instead of random weights, of the settings' first size and activation. progress: is
    called after each iteration with the regression's name, Gflop used, Gflop allotted, and `progress_text`.

    With a ``checkpoint`` path the state is written there every ``checkpoint_every_s``, and on Ctrl-C in this process
    (workers are ended at once); a later call with the same regression and settings goes on from it (its budget too),
    or returns a finished fit at once. More ``max_gflop`` or ``max_iterations`` than before continues a fit that those
    had ended.

    Raises ValueError for a regression that cannot be fitted (NaN, shapes), for a start of another size, and for a
    checkpoint of other data.
    """
    settings = settings or TrainingSettings()
    check(regression)
    if start is not None:
        _check_start(regression, settings, start)
    identity = _identity(regression, settings, start)

    def make(saved: dict[str, Any] | None) -> tuple[Trainer, float]:
        return Trainer(regression, settings, saved, start), float(saved["cpu_s"]) if saved else 0.0

    with threadpool_limits(settings.threads):
        trainer, cpu_s = checkpoint_file.resume(checkpoint, identity, make)
        snapshot, written = trainer.snapshot(), time.monotonic()
        try:
            while not trainer.stop_reason:
                began = time.thread_time()
                trainer.iterate()
                cpu_s += time.thread_time() - began
                snapshot = trainer.snapshot()
                if checkpoint and time.monotonic() - written >= settings.checkpoint_every_s:
                    checkpoint_file.write(checkpoint, identity, {**trainer.content(snapshot), "cpu_s": cpu_s})
                    written = time.monotonic()
                if progress:
                    remark = progress_text(settings.sizes[trainer.level], trainer.training_rms)
                    progress(regression.name, trainer.gflop, settings.max_gflop, remark)
        finally:  # the last whole iteration, on Ctrl-C too
            if checkpoint:
                checkpoint_file.write(checkpoint, identity, {**trainer.content(snapshot), "cpu_s": cpu_s})
        return _result(regression, trainer, cpu_s)


def _identity(r: Regression, settings: TrainingSettings, start: Network | None) -> checkpoint_file.Identity:
    arrays = [r.inputs, r.targets, r.weights, r.validation, np.asarray(r.false_load, float), np.asarray(r.tolerance)]
    if r.domain is not None:
        arrays.append(r.domain)
    if start is not None:
        arrays += [start.input_shift, start.input_scale, np.asarray(start.output_scale)]
        arrays += [*start.weights, *start.biases]
    return checkpoint_file.Identity.of(settings, r.name, arrays)


def _check_start(regression: Regression, settings: TrainingSettings, start: Network) -> None:
    got = (len(start.input_shift), start.hidden, start.outputs, start.activation)
    expected = (regression.inputs.shape[1], settings.sizes[0], regression.outputs, settings.activation)
    if got != expected:
        raise ValueError(
            f"regression {regression.name}: start has (inputs, hidden layers, outputs, activation) {got}, "
            f"expected {expected}"
        )


def _result(regression: Regression, trainer: Trainer, cpu_s: float) -> Fit:
    network = trainer.best_network()
    squares = np.reshape(regression.residuals(network) ** 2, (len(regression.inputs), -1)).sum(axis=1)
    training, validation = (
        float(np.sqrt(np.sum(squares[rows]) / rows.sum())) if rows.any() else np.nan
        for rows in (~regression.validation, regression.validation)
    )
    history = {name: np.array(column) for name, column in trainer.history.items()}
    return Fit(network, history, trainer.stop_reason, training, validation, trainer.gflop, cpu_s)
