"""History models [EF15 §1]: time-delay network, NARX network, Hammerstein-Wiener; they follow a motion in time.

Contact loads here depend on the pose alone; what the past adds is knowledge of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from casadi_contact.core.conventions import Array
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings


@dataclass(frozen=True)
class Cycles:
    """poses (cycles, frames, 6), loads (cycles, frames, L) in order; the last cycles are held back to stop training."""

    poses: Array
    loads: Array
    held_back: int

    @property
    def validation(self) -> np.ndarray:
        """True for the frames (cycles·frames,) that are held back."""
        cycles, frames = self.poses.shape[:2]
        return np.repeat(np.arange(cycles) >= cycles - self.held_back, frames)

    @property
    def scale(self) -> tuple[Array, Array]:
        """Mean and standard deviation (L,) of the loads (1 where a load never varies)."""
        flat = self.loads[: -self.held_back].reshape(-1, self.loads.shape[2])
        deviation = flat.std(axis=0)
        return flat.mean(axis=0), np.where(deviation > 0.0, deviation, 1.0)

    def network(self, inputs: Array, hidden: int, gflop: float) -> Network:
        """A network from inputs (cycles, frames, m) to the scaled loads, by Levenberg-Marquardt."""
        mean, deviation = self.scale
        targets = ((self.loads - mean) / deviation).reshape(len(self.validation), -1)
        targets = targets[:, 0] if targets.shape[1] == 1 else targets
        flat = inputs.reshape(len(targets), -1)
        regression = Regression("all loads", flat, targets, np.ones(targets.shape), self.validation, 0.0)
        return fit(regression, TrainingSettings(sizes=((hidden,),), max_gflop=gflop)).network


def delayed(cycles: Array, delays: int) -> Array:
    """(cycles, frames, k·(delays + 1)) of (cycles, frames, k): each frame, then those before it; a cycle's first frame
    stands in for the past that is not there."""
    frames = np.arange(cycles.shape[1])
    return np.concatenate([cycles[:, np.maximum(frames - d, 0)] for d in range(delays + 1)], axis=2)


class TimeDelay:
    """F_t = network(x_t, x_{t-1}, x_{t-2})."""

    delays, hidden = 2, 24

    def __init__(self, cycles: Cycles, gflop: float) -> None:
        self._mean, self._deviation = cycles.scale
        self._network = cycles.network(delayed(cycles.poses, self.delays), self.hidden, gflop)

    def follow(self, poses: Array) -> Array:
        """Loads (cycles, frames, L) of poses (cycles, frames, 6)."""
        inputs = delayed(poses, self.delays)
        value = self._network.value(inputs.reshape(-1, inputs.shape[2])).reshape(*poses.shape[:2], -1)
        return np.asarray(self._mean + self._deviation * value)


class Narx:
    """F_t = network(x_t, x_{t-1}, F_{t-1}): trained with the true past loads plus noise, used with its own, so that
    errors feed back; without the noise it would trust its own past too much."""

    hidden, noise, rounds_at_rest = 24, 0.1, 30

    def __init__(self, cycles: Cycles, gflop: float) -> None:
        self._mean, self._deviation = cycles.scale
        previous = np.maximum(np.arange(cycles.poses.shape[1]) - 1, 0)
        noise = self.noise * self._deviation * np.random.default_rng(0).normal(size=cycles.loads.shape)
        inputs = np.concatenate([delayed(cycles.poses, 1), cycles.loads[:, previous] + noise], axis=2)
        self._network = cycles.network(inputs, self.hidden, gflop)

    def _next(self, poses: Array, before: Array, loads: Array) -> Array:
        value = self._network.value(np.hstack([poses, before, loads])).reshape(len(poses), -1)
        return np.asarray(self._mean + self._deviation * value)

    def follow(self, poses: Array) -> Array:
        """Loads (cycles, frames, L) of poses (cycles, frames, 6); each cycle begins at rest."""
        before, loads, found = poses[:, 0], np.tile(self._mean, (len(poses), 1)), []
        for _ in range(self.rounds_at_rest):
            loads = self._next(before, before, loads)
        for frame in range(poses.shape[1]):
            loads = self._next(poses[:, frame], before, loads)
            before = poses[:, frame]
            found.append(loads)
        return np.stack(found, axis=1)


class HammersteinWiener:
    """For each load u_t = Σ_i f_i(x_{i,t}), w_t = a·w_{t-1} + (1 - a)·u_t, F_t = g(w_t): piecewise linear f_i
    (10 knots) and g (8 hinges) around a linear filter that passes constants unchanged. Fitted by least squares."""

    knots, hinges, ridge, evaluations = 10, 8, 1e-3, 30

    def __init__(self, cycles: Cycles, gflop: float) -> None:
        self._mean, self._deviation = cycles.scale
        learned, loads = cycles.poses[: -cycles.held_back], cycles.loads[: -cycles.held_back]
        self._low, self._high = learned.min(axis=(0, 1)), learned.max(axis=(0, 1))
        basis, targets = self._basis(learned), (loads - self._mean) / self._deviation
        self._parameters = [self._fit(basis, targets[..., k]) for k in range(targets.shape[2])]

    def _basis(self, poses: Array) -> Array:
        """Hat functions (..., 6·knots); a curve is this times its values at the knots."""
        share = (poses - self._low) / np.where(self._high > self._low, self._high - self._low, 1.0) * (self.knots - 1)
        hats = np.maximum(1.0 - np.abs(np.clip(share, 0, self.knots - 1)[..., None] - np.arange(self.knots)), 0.0)
        return np.reshape(hats, (*poses.shape[:-1], 6 * self.knots))

    def _output(self, basis: Array, parameters: Array) -> Array:
        inputs, pole, heights = np.split(parameters, [basis.shape[-1], basis.shape[-1] + 1])
        u, a = basis @ inputs, np.tanh(pole)
        w = lfilter(1.0 - a, [1.0, -a[0]], u, axis=1, zi=a * u[:, :1])[0]
        return np.asarray(w + np.maximum(w[..., None] - np.linspace(-2.0, 2.0, self.hinges), 0.0) @ heights)

    def _fit(self, basis: Array, target: Array) -> Array:
        flat = basis.reshape(-1, basis.shape[2])
        ridge = self.ridge * len(flat) / self.knots * np.eye(flat.shape[1])
        additive = np.linalg.solve(flat.T @ flat + ridge, flat.T @ target.ravel())
        start = np.concatenate([additive, [0.1], np.zeros(self.hinges)])

        def residuals(parameters: Array) -> Array:
            off = (self._output(basis, parameters) - target).ravel() / np.sqrt(target.size)
            return np.concatenate([off, np.sqrt(self.ridge / len(start)) * (parameters - start)])

        return np.asarray(least_squares(residuals, start, max_nfev=self.evaluations).x)

    def follow(self, poses: Array) -> Array:
        """Loads (cycles, frames, L) of poses (cycles, frames, 6); each cycle begins at rest."""
        basis = self._basis(poses)
        value = np.stack([self._output(basis, parameters) for parameters in self._parameters], axis=-1)
        return np.asarray(self._mean + self._deviation * value)


HISTORY_MODELS: dict[str, Any] = {
    "time-delay network": TimeDelay,
    "NARX network": Narx,
    "Hammerstein-Wiener": HammersteinWiener,
}
