"""Fit one network to one regression: grow, restart, stop, and go on from where an earlier run ended."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from casadi_contact.core.conventions import Array, Update
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training import checkpoint as checkpoint_file
from casadi_contact.networks.training.search import Search
from casadi_contact.networks.training.settings import TrainingSettings


@dataclass(frozen=True)
class FitOutcome:
    """How a fit went. rms, validation_rms: root-mean-square weighted residual of what was fitted on training and
    validation rows [N or N·mm], the latter NaN without validation rows. history: training_rms, validation_rms, gflop
    and size (index into the settings' sizes), one entry an iteration. stop_reason: see `stopping`. gflop: work done.
    cpu_s: CPU seconds of the thread that fitted; both count interrupted runs too."""

    history: dict[str, Array]
    stop_reason: str
    rms: float
    validation_rms: float
    gflop: float
    cpu_s: float


@dataclass(frozen=True)
class Fit(FitOutcome):
    """A fitted network."""

    network: Network

    @property
    def parameter_count(self) -> int:
        """Number of weights and biases."""
        return self.network.parameter_count

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons per hidden layer."""
        return self.network.hidden


def check(regression: Regression) -> None:
    """Raises ValueError, naming the regression, for what no fit can repair."""
    name, rows = regression.name, len(regression.inputs)
    if regression.inputs.ndim != 2 or regression.inputs.shape[1] < 1:
        raise ValueError(f"regression {name}: inputs has shape {regression.inputs.shape}, expected (n, k)")
    if np.ndim(regression.targets) > 1 and regression.outputs < 2:
        raise ValueError(
            f"regression {name}: targets have shape {np.shape(regression.targets)}, expected (n,) for one output"
        )
    per_row = (rows,) if np.ndim(regression.targets) == 1 else (rows, regression.outputs)
    wanted = [("targets", per_row), ("weights", per_row), ("validation", (rows,))]
    for column, expected in [*wanted, *([] if regression.domain is None else [("domain", (rows,))])]:
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
    training = ~regression.validation
    if (regression.weights < 0.0).any() or not (regression.weights[training] > 0.0).any():
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
    called after each iteration with the regression's name, Gflop used, Gflop allotted, and `course_text`.

    With a ``checkpoint`` path the state is written there every ``checkpoint_every_s``, and on Ctrl-C in this process
    (workers are ended at once); a later call with the same regression and settings goes on from it (its budget too),
    or returns a finished fit at once.
    More ``max_gflop`` or ``max_iterations`` than before continues a fit that those had ended.

    Raises ValueError for a regression that cannot be fitted (NaN, shapes), for a start of another size, and for a
    checkpoint of other data.
    """
    settings = settings or TrainingSettings()
    with threadpool_limits(settings.threads), Run(regression, settings, checkpoint, progress, start) as run:
        began = time.thread_time()
        while not run.search.stop_reason:
            run.search.iterate()
            now = time.thread_time()
            run.note(now - began)
            began = now
        return run.result()


def _identity(r: Regression, settings: TrainingSettings, start: Network | None) -> checkpoint_file.Identity:
    domain = () if r.domain is None else (r.domain,)
    numbers = (np.asarray(number, dtype=float) for number in (r.false_load, r.tolerance))
    arrays = (r.inputs, r.targets, r.weights, r.validation, *numbers, *domain)
    return checkpoint_file.identity(settings, (r.name,), arrays, () if start is None else (start,))


class Run:
    """A fit in progress: its search, its checkpoint and who is told. Leaving the block keeps the state of the last
    whole iteration, on Ctrl-C too."""

    def __init__(
        self,
        regression: Regression,
        settings: TrainingSettings,
        checkpoint: Path | None,
        progress: Update | None,
        start: Network | None,
        kind: type[Search] = Search,
    ) -> None:
        check(regression)
        if start is not None:
            _check_start(regression, settings, start)
        self._checkpoint, self._progress = checkpoint, progress
        self._identity = _identity(regression, settings, start)
        self.search, self._cpu_s = checkpoint_file.go_on(
            checkpoint,
            self._identity,
            lambda saved: (kind(regression, settings, saved, start), float(saved["cpu_s"]) if saved else 0.0),
        )
        self._snapshot, self._written = self.search.snapshot(), time.monotonic()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self._write()

    def note(self, cpu_s: float) -> None:
        """After an iteration that took so many CPU seconds: keep its state, and tell of it."""
        search, settings = self.search, self.search.settings
        self._cpu_s += cpu_s
        self._snapshot = search.snapshot()
        if time.monotonic() - self._written >= settings.checkpoint_every_s:
            self._write()
        if self._progress:
            remark = course_text(settings.sizes[search.level], search.training_rms)
            self._progress(search.regression.name, search.gflop, settings.max_gflop, remark)

    def _write(self) -> None:
        if self._checkpoint:
            content = {**self.search.content(self._snapshot), "cpu_s": self._cpu_s}
            checkpoint_file.write(self._checkpoint, self._identity, content)
            self._written = time.monotonic()

    def result(self) -> Fit:
        """The best network so far, and its course."""
        return _result(self.search.regression, self.search, self._cpu_s)


def course_text(hidden: Sequence[int], rms: float) -> str:
    """What an `Update` is told beside the work of a fit: its unit, hidden layers and training RMS."""
    return f"Gflop, {size_text(hidden)} RMS {rms:.3g}"


def _check_start(regression: Regression, settings: TrainingSettings, start: Network) -> None:
    got = (len(start.input_shift), start.hidden, start.outputs, start.activation)
    wanted = (regression.inputs.shape[1], settings.sizes[0], regression.outputs, settings.activation)
    if got != wanted:
        raise ValueError(
            f"regression {regression.name}: start has (inputs, hidden layers, outputs, activation) {got}, "
            f"expected {wanted}"
        )


def _result(regression: Regression, search: Search, cpu_s: float) -> Fit:
    network = search.best_network()
    weighted = regression.residuals(network)
    rms = {
        chosen: float(np.sqrt(np.sum(weighted[rows] ** 2) / rows.sum())) if rows.any() else np.nan
        for chosen, rows in ((False, ~regression.validation), (True, regression.validation))
    }
    history = search.history.arrays()
    return Fit(history, search.stop_reason, rms[False], rms[True], search.gflop, cpu_s, network)
