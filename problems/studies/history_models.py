"""A history model [EF15 §1]: a time-delay network, which follows a motion in time.

Contact loads here depend on the pose alone; what the past adds is knowledge of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
