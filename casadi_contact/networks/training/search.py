"""The course of one fit: iterate, judge, grow or restart, remember the best. Its whole state fits in a checkpoint."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training import stopping
from casadi_contact.networks.training.arrays import NumpyArrays
from casadi_contact.networks.training.growth import widen, will_reach
from casadi_contact.networks.training.history import History
from casadi_contact.networks.training.levenberg_marquardt import LevenbergMarquardt, State
from casadi_contact.networks.training.mlp import Mlp
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.trunk import TrunkMlp
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten

# A larger or restarted network needs time of its own; with less of the allotment left, the present one goes on.
_SHARE_FOR_ANOTHER = 0.2
_LEAST_ITERATIONS = 20


class Search:
    """One fit in progress; `iterate` until ``stop_reason`` is set."""

    _lm: Any  # LevenbergMarquardt, or a member of a batch

    def __init__(
        self,
        regression: Regression,
        settings: TrainingSettings,
        saved: dict[str, Any] | None = None,
        start: Network | None = None,
    ) -> None:
        self.regression, self.settings, self._given = regression, settings, start
        self._arrays = NumpyArrays()
        self._training, self._validation = ~regression.validation, regression.validation
        self.history = History()
        self.level = self.attempt = self.began = 0
        self.stop_reason = ""
        self.flop = self._counted = 0
        self._best_level, self._best_score = 0, np.inf
        if saved is None:
            self._start(self._fresh())
            self._best = self._lm.parameters
        else:
            self._restore(saved)

    # --- where it stands

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
        return unflatten(self._best, self._fresh(self._best_level))

    def snapshot(self) -> dict[str, Any]:
        """The present state, to be stored by `content`; cheap, and untouched by later iterations."""
        return {
            **{f"lm_{name}": value for name, value in asdict(self._lm.state()).items()},
            "level": self.level,
            "attempt": self.attempt,
            "began": self.began,
            "stop_reason": self.stop_reason,
            "flop": self.flop,
            "best": self._best,
            "best_level": self._best_level,
            "best_score": self._best_score,
            "entries": len(self.history),
        }

    def content(self, snapshot: dict[str, Any]) -> dict[str, Any]:
        """Everything that `__init__` needs to go on from a snapshot, as arrays and numbers."""
        history = self.history.arrays(snapshot["entries"])
        return {**snapshot, **{f"history_{name}": column for name, column in history.items()}}

    def _restore(self, saved: dict[str, Any]) -> None:
        self.history = History.from_arrays({k[8:]: v for k, v in saved.items() if k.startswith("history_")})
        self.level, self.attempt, self.began, self.flop = (int(saved[k]) for k in ("level", "attempt", "began", "flop"))
        self._best, self._best_level = saved["best"], int(saved["best_level"])
        self._best_score = float(saved["best_score"])
        lm = {k[3:]: v if v.ndim else v.item() for k, v in saved.items() if k.startswith("lm_")}
        self.stop_reason = str(saved["stop_reason"])
        self._start(self._fresh(), State(**lm))
        if self.stop_reason in stopping.LIMITS:
            self.stop_reason = self._limit_reached()

    # --- one iteration

    def iterate(self) -> None:
        """One step of Levenberg-Marquardt, then what §2.6 says to do about it."""
        self._lm.step()
        self.judge()

    def judge(self) -> None:
        """What §2.6 says to do about a step that was made."""
        validation_rms = self._validation_rms()
        self._count()
        self.history.add(self._lm.rms, validation_rms, self.gflop, self.level)
        score = self._lm.rms if np.isnan(validation_rms) else validation_rms
        reached = self._error_reached(validation_rms)
        if reached or score < self._best_score:
            self._best, self._best_level, self._best_score = self._lm.parameters, self.level, score
        if reached:
            self.stop_reason = stopping.ERROR_REACHED
        elif reason := self._limit_reached():
            self.stop_reason = reason
        elif stopping.validation_rising(self._phase("validation_rms"), self.settings.max_validation_rises):
            self.stop_reason = stopping.VALIDATION_RISING
        elif self._stands_still():
            if self._can_begin_another() and self._larger():
                self._grow()
            elif self._can_begin_another() and self.attempt < self.settings.restarts:
                self.attempt += 1
                self.began = len(self.history)
                self._start(self._fresh())
            else:
                self.stop_reason = stopping.STALLED
        elif self._can_begin_another() and self._larger() and self._trend_misses():
            self._grow()

    def _error_reached(self, validation_rms: float) -> bool:
        of = self.regression
        if not stopping.error_reached(self._lm.rms, validation_rms, of.tolerance):
            return False
        residuals = of.residuals(unflatten(self._lm.parameters, self._fresh()))
        return stopping.reached_in_every_domain(residuals, of.validation, of.domain, of.tolerance)

    def _limit_reached(self) -> str:
        if self.settings.max_iterations is not None and len(self.history) >= self.settings.max_iterations:
            return stopping.ITERATION_LIMIT
        return stopping.BUDGET_USED if stopping.budget_used(self.gflop, self.settings.max_gflop) else ""

    def _count(self) -> None:
        """Count what the present network has cost since it was counted last."""
        now = self._flop_of_network()
        self.flop, self._counted = self.flop + now - self._counted, now

    def _flop_of_network(self) -> int:
        """Operations of the present network since it (or the run) began."""
        return self._lm.flop + (self._validation_mlp.flop if self._validation_mlp else 0)

    def _phase(self, column: str) -> list[float]:
        """Entries since the present network began."""
        return getattr(self.history, column)[self.began :]

    def _stands_still(self) -> bool:
        settings = self.settings
        return self._lm.exhausted or stopping.stalled(
            self._phase("training_rms"), settings.stall_window, settings.stall_improvement
        )

    def _effort(self) -> tuple[np.ndarray, float]:
        """Effort at each entry of the history and at the end: iterations if these are limited, else Gflop."""
        if self.settings.max_iterations is not None:
            return np.arange(1.0, len(self.history) + 1.0), float(self.settings.max_iterations)
        return np.array(self.history.gflop), self.settings.max_gflop

    def _can_begin_another(self) -> bool:
        effort, end = self._effort()
        return end - effort[-1] >= _SHARE_FOR_ANOTHER * end

    def _larger(self) -> bool:
        return self.level + 1 < len(self.settings.sizes)

    def _trend_misses(self) -> bool:
        if len(self.history) % 10:
            return False
        effort, end = self._effort()
        before = effort[self.began - 1] if self.began else 0.0
        own = effort[self.began :] - before
        if len(own) < _LEAST_ITERATIONS or own[-1] < self.settings.growth_share * end:
            return False
        return not will_reach(own, self._phase("training_rms"), end - before, self.regression.tolerance)

    # --- networks

    def _seed(self, level: int) -> list[int]:
        return [self.settings.seed, level, self.attempt]

    def _fresh(self, level: int | None = None) -> Network:
        """A random network of one size, scaled by the training rows alone; first of all the given start."""
        level = self.level if level is None else level
        if self._given is not None and level == 0 and self.attempt == 0:
            return self._given
        rows, regression = self._training, self.regression
        sizes, activation = self.settings.sizes[level], self.settings.activation
        columns = regression.inputs[rows], regression.targets[rows]
        fresh = initial_network(*columns, sizes, activation, self._seed(level))
        if self._given is None or level > 0:
            return fresh
        scales = ("input_shift", "input_scale", "output_scale")  # kept, so that weights of all attempts compare
        return replace(fresh, **{name: getattr(self._given, name) for name in scales})

    def _grow(self) -> None:
        """Go on with the next size: warm if it is only wider, from random weights if it is deeper (see `widen`)."""
        present = unflatten(self._lm.parameters, self._fresh())
        self.level += 1
        self.began = len(self.history)
        hidden = self.settings.sizes[self.level]
        same_depth = len(hidden) == len(present.hidden)
        self._start(widen(present, hidden, self._seed(self.level)) if same_depth else self._fresh())

    def _start(self, network: Network, state: State | None = None) -> None:
        def mlp(rows: np.ndarray) -> Mlp:
            kind = Mlp if network.outputs == 1 else TrunkMlp
            return kind(network, *self._columns(rows), self._arrays, self.settings.chunk_rows)

        self._lm = LevenbergMarquardt(mlp(self._training), flatten(network), self._drawing_seed(), state)
        self._validation_mlp = mlp(self._validation) if self._validation.any() else None
        self._counted = 0 if state is None else self._lm.flop  # what a resumed fit does again was counted before
        self._count()

    def _drawing_seed(self) -> int:
        return int(np.random.default_rng(self._seed(self.level)).integers(2**31))

    def _columns(self, rows: np.ndarray) -> tuple[Array, Array, Array, Array | float]:
        """Inputs, targets, weights and false loads of these rows."""
        chosen = self.regression.of_rows(rows)
        return chosen.inputs, chosen.targets, chosen.weights, chosen.false_load

    def _validation_rms(self) -> float:
        if self._validation_mlp is None:
            return np.nan
        residuals = self._validation_mlp.weighted_residuals(self._arrays.array(self._lm.parameters))
        return float(np.sqrt(np.sum(residuals**2) / len(residuals)))
