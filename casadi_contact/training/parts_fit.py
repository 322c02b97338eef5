"""Fit the networks of a patch's parts on, together: budget, stopping and checkpoint as of a single network's `fit`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from casadi_contact.conventions import Array, Update
from casadi_contact.network import Network, PartsRegression
from casadi_contact.training import checkpoint as checkpoint_file
from casadi_contact.training import stopping
from casadi_contact.training.fit import FitOutcome, course_text
from casadi_contact.training.history import History
from casadi_contact.training.levenberg_marquardt import LevenbergMarquardt, State
from casadi_contact.training.parts_mlp import PartsMlp, flatten_parts, unflatten_parts
from casadi_contact.training.settings import TrainingSettings

# As in `levenberg_marquardt`. What parts do to each other is not in the preconditioner: steps take many products, and
# half as many give the same error in less work.
_ACCURACY = 0.3
# Times the training RMS: what a validation row counts at most. Where no row tells what a part does, single poses are
# off by hundreds of newtons at one step and not at the next: they are not to choose among networks.
_MOST = 10.0


@dataclass(frozen=True)
class PartsFit(FitOutcome):
    """Fitted networks by name."""

    networks: dict[str, Network]

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons per hidden layer of the first part."""
        return next(iter(self.networks.values())).hidden


def fit_parts(
    regression: PartsRegression,
    settings: TrainingSettings,
    checkpoint: Path | None,
    progress: Update | None,
    start: Sequence[Network],
) -> PartsFit:
    """Go on from the parts' own networks within ``settings.max_gflop``; the networks of the least validation error (of
    the least training error without validation rows) are returned. In it, and in the history, a validation row counts
    up to ten times the training RMS. Checkpoint and progress as for `fit`."""
    identity = _identity(regression, settings, start)
    with threadpool_limits(settings.threads):
        course = checkpoint_file.go_on(checkpoint, identity, lambda saved: _Course(regression, settings, start, saved))
        written = time.monotonic()
        try:
            while not course.stop_reason:
                course.iterate()
                if checkpoint and time.monotonic() - written >= settings.checkpoint_every_s:
                    checkpoint_file.write(checkpoint, identity, course.kept)
                    written = time.monotonic()
                if progress:
                    progress(
                        regression.name, course.gflop, settings.max_gflop, course_text(start[0].hidden, course.rms)
                    )
        finally:
            if checkpoint:
                checkpoint_file.write(checkpoint, identity, course.kept)
        return course.result()


class _Course:
    """A fit in progress; kept: its state after the last whole iteration, to be written whenever."""

    def __init__(
        self,
        regression: PartsRegression,
        settings: TrainingSettings,
        start: Sequence[Network],
        saved: dict[str, Any] | None,
    ) -> None:
        self._regression, self._settings, self._start = regression, settings, start
        self._training = regression.of_rows(np.flatnonzero(~regression.validation))
        self._validation = regression.of_rows(np.flatnonzero(regression.validation))
        self._mlp = PartsMlp(start, self._training, settings.chunk_rows)
        self.history, self._before, self._cpu_s, state = History(), 0, 0.0, None
        self._best, self._best_score, self.stop_reason = flatten_parts(start), np.inf, ""
        if saved is not None:
            state = State(**{f.name: _plain(saved[f"lm_{f.name}"]) for f in fields(State)})
            self.history = History.from_arrays({k[8:]: v for k, v in saved.items() if k.startswith("history_")})
            self._before, self._cpu_s = int(saved["flop"]), float(saved["cpu_s"])
            self._best, self._best_score = saved["best"], float(saved["best_score"])
            self.stop_reason = str(saved["stop_reason"])
        self._lm = LevenbergMarquardt(self._mlp, flatten_parts(start), settings.seed, state, _ACCURACY)  # type: ignore[arg-type]
        self._before -= 0 if state is None else self._lm.flop  # what a resumed fit does again was counted before
        if self.stop_reason in stopping.LIMITS and not stopping.budget_used(self.gflop, settings.max_gflop):
            self.stop_reason = ""
        self.kept = self._content()

    @property
    def gflop(self) -> float:
        """Work done so far [10⁹ operations]."""
        return 1e-9 * (self._before + self._lm.flop)

    @property
    def rms(self) -> float:
        """Error on the training rows."""
        return self._lm.rms

    def iterate(self) -> None:
        """One step, and whether it was the last."""
        began, settings = time.thread_time(), self._settings
        self._lm.step()
        validation_rms = self._rms_at(self._lm.parameters, self._validation, _MOST * self._lm.rms)
        self.history.add(self._lm.rms, validation_rms, self.gflop, 0)
        score = self._lm.rms if np.isnan(validation_rms) else validation_rms
        if score < self._best_score:
            self._best, self._best_score = self._lm.parameters, score
        if self._error_reached(validation_rms):
            self.stop_reason = stopping.ERROR_REACHED
        elif stopping.budget_used(self.gflop, settings.max_gflop):
            self.stop_reason = stopping.BUDGET_USED
        elif stopping.validation_rising(self.history.validation_rms, settings.max_validation_rises):
            self.stop_reason = stopping.VALIDATION_RISING
        elif self._lm.exhausted or stopping.stalled(
            self.history.training_rms, settings.stall_window, settings.stall_improvement
        ):
            self.stop_reason = stopping.STALLED
        self._cpu_s += time.thread_time() - began
        self.kept = self._content()

    def _error_reached(self, validation_rms: float) -> bool:
        of = self._regression
        if not stopping.error_reached(self._lm.rms, validation_rms, of.tolerance):
            return False
        residuals = self._residuals_at(self._lm.parameters, of)
        return stopping.reached_in_every_domain(residuals, of.validation, of.domain, of.tolerance)

    def _content(self) -> dict[str, Any]:
        return {
            **{f"lm_{name}": value for name, value in asdict(self._lm.state()).items()},
            **{f"history_{name}": column for name, column in self.history.arrays().items()},
            "flop": self._before + self._lm.flop,
            "cpu_s": self._cpu_s,
            "best": self._best,
            "best_score": self._best_score,
            "stop_reason": self.stop_reason,
        }

    def _rms_at(self, parameters: Array, rows: PartsRegression, most: float = np.inf) -> float:
        """√(Σr²/n), no row of which counts more than ``most``; NaN without rows."""
        if not len(rows.validation):
            return np.nan
        residuals = self._residuals_at(parameters, rows)
        return float(np.sqrt(np.minimum((residuals**2).sum(axis=1), most**2).mean()))

    def _residuals_at(self, parameters: Array, rows: PartsRegression) -> Array:
        pairs = zip(unflatten_parts(parameters, self._start), rows.inputs, strict=True)
        return rows.residuals(np.stack([network.value(inputs) for network, inputs in pairs], axis=1))

    def result(self) -> PartsFit:
        """The best networks so far, and their course."""
        networks = dict(zip(self._regression.names, unflatten_parts(self._best, self._start), strict=True))
        rms, validation_rms = (self._rms_at(self._best, rows) for rows in (self._training, self._validation))
        history = self.history.arrays()
        return PartsFit(history, self.stop_reason, rms, validation_rms, self.gflop, self._cpu_s, networks)


def _plain(value: np.ndarray) -> Any:
    return value if value.ndim else value.item()


def _identity(r: PartsRegression, settings: TrainingSettings, start: Sequence[Network]) -> checkpoint_file.Identity:
    domain = () if r.domain is None else (r.domain,)
    arrays = (*r.inputs, r.shares, r.wanted, r.targets, r.weights, r.validation, np.asarray(r.tolerance), *domain)
    return checkpoint_file.identity(settings, (r.name,), arrays, start)
