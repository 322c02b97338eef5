"""The course of one fit: iterate, stop, grow or restart, keep the best network. Its state fits in a checkpoint."""

import time
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.levenberg_marquardt import LevenbergMarquardt, State
from casadi_contact.networks.training.mlp import Mlp, SeveralOutputsMlp
from casadi_contact.networks.training.settings import (
    BUDGET_USED,
    ERROR_REACHED,
    ITERATION_LIMIT,
    LIMITS,
    STALLED,
    VALIDATION_RISING,
    TrainingSettings,
    error_reached,
    extrapolated_error,
    stalled,
    typical_error,
    validation_rising,
)
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten, widen

# A size gets this share of the budget, and so many iterations, before its trend decides; a larger or restarted network
# needs work of its own: with a smaller share of the budget left the present one goes on.
_GROWTH_SHARE, _GROWTH_ITERATIONS, _SHARE_FOR_ANOTHER = 0.05, 20, 0.2
HISTORY = ("training_rms", "validation_error", "gflop", "size")
_KEPT = ("level", "attempt", "began", "stop_reason", "flop", "cpu_s", "best", "best_level", "best_score")


class Trainer:
    """One fit in progress; `iterate` until ``stop_reason`` is set.

    history: lists with one entry an iteration: training_rms, validation_error (`typical_error`), Gflop used, and
    the index of the network's size in the settings. level: that index now; attempt, began: restarts of this size,
    and the entry at which the present network began. flop, cpu_s: work and CPU seconds of this thread, interrupted runs
    included. best: parameters of the best network so far, of size best_level. saved: the content of a checkpoint;
    start: a network to begin from, not random weights.
    """

    def __init__(
        self,
        regression: Regression,
        settings: TrainingSettings,
        saved: dict[str, Any] | None = None,
        start: Network | None = None,
    ) -> None:
        self.regression, self.settings, self._given = regression, settings, start
        self._held_back = regression.of_rows(regression.validation)
        self.history: dict[str, list[Any]] = {name: [] for name in HISTORY}
        self.level = self.attempt = self.began = 0
        self.stop_reason = ""
        self.flop = self._counted = 0
        self.cpu_s = 0.0
        self.best_level, self.best_score = 0, np.inf
        if saved is None:
            self._start(self._fresh())
            self.best = self._lm.parameters
        else:
            self._restore(saved)

    # --- state

    @property
    def gflop(self) -> float:
        """Work done so far, 10⁹ floating-point operations, that of interrupted runs included."""
        return 1e-9 * self.flop

    @property
    def training_rms(self) -> float:
        """Error of the present network on the training rows."""
        return self._lm.rms

    def best_network(self) -> Network:
        """The network that met the tolerance; else the one of the least validation error (training error without)."""
        return unflatten(self.best, self._fresh(self.best_level))

    def content(self) -> dict[str, Any]:
        """Everything that `__init__` needs to go on from here, untouched by later iterations."""
        lm = {f"lm_{name}": value for name, value in asdict(self._lm.state()).items()}
        history = {f"history_{name}": list(column) for name, column in self.history.items()}
        return {**lm, **history, **{name: getattr(self, name) for name in _KEPT}}

    def _restore(self, saved: dict[str, Any]) -> None:
        self.history = {name: saved[f"history_{name}"].tolist() for name in HISTORY}
        for name in _KEPT:
            setattr(self, name, saved[name] if saved[name].ndim else saved[name].item())
        lm = {k[3:]: v if v.ndim else v.item() for k, v in saved.items() if k.startswith("lm_")}
        self._start(self._fresh(), State(**lm))
        if self.stop_reason in LIMITS:
            self.stop_reason = self._limit_reached()

    # --- one iteration

    def iterate(self) -> None:
        """One step of Levenberg-Marquardt, then stop, grow or restart as [EF15 §2.6] says."""
        began = time.thread_time()
        self._lm.step()
        held, tolerance = self._held_back, self.regression.tolerance
        squares = held.squares(unflatten(self._lm.parameters, self._lm.mlp.like))
        self.flop += 2 * len(squares) * self._lm.mlp.parameter_count
        self._count()
        self.cpu_s += time.thread_time() - began
        error = typical_error(squares, tolerance)
        for name, value in zip(HISTORY, (self._lm.rms, error, self.gflop, self.level), strict=True):
            self.history[name].append(value)
        score = error if len(squares) else self._lm.rms
        reached = error_reached(self._lm.rms, squares, held.domain, tolerance)
        if reached or score < self.best_score:
            self.best, self.best_level, self.best_score = self._lm.parameters, self.level, score
        self.update_stopping(reached)

    def update_stopping(self, reached: bool) -> None:
        """Set ``stop_reason``, or begin a larger or another network, after a step; reached: the tolerance is met."""
        settings, errors = self.settings, self._phase("training_rms")
        if reached:
            self.stop_reason = ERROR_REACHED
        elif reason := self._limit_reached():
            self.stop_reason = reason
        elif validation_rising(self._phase("validation_error"), settings.max_validation_rises):
            self.stop_reason = VALIDATION_RISING
        elif self._lm.exhausted or stalled(errors, settings.stall_window, settings.stall_improvement):
            if self._can_begin_another() and self._can_grow():
                self._grow()
            elif self._can_begin_another() and self.attempt < settings.restarts:
                self.attempt += 1
                self.began = len(self.history["gflop"])
                self._start(self._fresh())
            else:
                self.stop_reason = STALLED
        elif self._can_begin_another() and self._can_grow() and self._trend_misses():
            self._grow()

    def _limit_reached(self) -> str:
        most = self.settings.max_iterations
        if most is not None and len(self.history["gflop"]) >= most:
            return ITERATION_LIMIT
        return BUDGET_USED if self.gflop >= self.settings.gflop_at_end(self.gflop, self.cpu_s) else ""

    def _count(self) -> None:
        """Count the work of the present network since it was counted last."""
        self.flop, self._counted = self.flop + self._lm.flop - self._counted, self._lm.flop

    def _phase(self, column: str) -> list[float]:
        """Entries since the present network began."""
        return self.history[column][self.began :]

    def _effort(self) -> tuple[np.ndarray, float]:
        """Effort at each entry of the history and at the end: iterations if these are limited, else Gflop."""
        gflop = self.history["gflop"]
        if self.settings.max_iterations is not None:
            return np.arange(1.0, len(gflop) + 1.0), float(self.settings.max_iterations)
        return np.array(gflop), self.settings.gflop_at_end(self.gflop, self.cpu_s)

    def _can_begin_another(self) -> bool:
        effort, end = self._effort()
        return bool(end - effort[-1] >= _SHARE_FOR_ANOTHER * end)

    def _can_grow(self) -> bool:
        return self.level + 1 < len(self.settings.sizes)

    def _trend_misses(self) -> bool:
        """True if the error's trend stays above the tolerance at the end; evaluated at every tenth iteration."""
        if len(self.history["gflop"]) % 10:
            return False
        effort, end = self._effort()
        before = effort[self.began - 1] if self.began else 0.0
        own = effort[self.began :] - before
        if len(own) < _GROWTH_ITERATIONS or own[-1] < _GROWTH_SHARE * end:
            return False
        expected = extrapolated_error(own, self._phase("training_rms"), end - before)
        return not expected <= self.regression.tolerance

    # --- networks

    def _seed(self, level: int) -> list[int]:
        return [self.settings.seed, level, self.attempt]

    def _fresh(self, level: int | None = None) -> Network:
        """A random network of one size, scaled by the training rows alone; first of all the given start."""
        level = self.level if level is None else level
        if self._given is not None and level == 0 and self.attempt == 0:
            return self._given
        rows, regression = ~self.regression.validation, self.regression
        sizes, activation = self.settings.sizes[level], self.settings.activation
        fresh = initial_network(regression.inputs[rows], regression.targets[rows], sizes, activation, self._seed(level))
        if self._given is None or level > 0:
            return fresh
        scales = ("input_shift", "input_scale", "output_scale")  # kept, so that weights of all attempts compare
        return replace(fresh, **{name: getattr(self._given, name) for name in scales})

    def _grow(self) -> None:
        """Go on with the next size: warm if it is only wider, from random weights if it is deeper (see `widen`)."""
        present = unflatten(self._lm.parameters, self._fresh())
        self.level += 1
        self.began = len(self.history["gflop"])
        hidden = self.settings.sizes[self.level]
        same_depth = len(hidden) == len(present.hidden)
        self._start(widen(present, hidden, self._seed(self.level)) if same_depth else self._fresh())

    def _start(self, network: Network, state: State | None = None) -> None:
        kind = Mlp if network.outputs == 1 else SeveralOutputsMlp
        mlp = kind(network, self.regression.of_rows(~self.regression.validation))
        seed = int(np.random.default_rng(self._seed(self.level)).integers(2**31))
        self._lm = LevenbergMarquardt(mlp, flatten(network), seed, state)
        self._counted = 0 if state is None else self._lm.flop  # what a resumed fit does again was counted before
        self._count()
