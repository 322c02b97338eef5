"""What every peer is fitted on: the training samples, shuffled, with scaled inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.dataset import Samples
from casadi_contact.scenes import Scene
from casadi_contact.structures.sample_rows import finite, fitted_rows


@dataclass(frozen=True)
class TrainingSet:
    """Training rows in random order, so that the first n are a fair choice of n.

    poses (n, 6), loads (n, L) of ``load_names``; validation_poses, validation_loads alike. centre and spread (6,) are
    mean and standard deviation of the training poses (spread 1 where a parameter never varies). ceiling (L,) is zero
    for the scene's sensitive loads and infinite for others: contact cannot pull, so a predicted pulling force is
    clamped to zero, as the paper does [EF15 §3.5].
    """

    scene: Scene
    load_names: tuple[str, ...]
    poses: Array
    loads: Array
    validation_poses: Array
    validation_loads: Array

    @classmethod
    def of(cls, samples: Samples, names: Sequence[str] | None = None, seed: int = 0) -> TrainingSet:
        """The training and validation samples; raises ValueError for an unknown load, NaN or no training samples."""
        names = tuple(samples.scene.load_names if names is None else names)
        rows, validation = fitted_rows(samples)
        poses, loads = finite("poses", samples.poses[rows]), finite("loads", samples.loads(names)[rows])
        order = np.random.default_rng(seed).permutation(np.flatnonzero(~validation))
        return cls(samples.scene, names, poses[order], loads[order], poses[validation], loads[validation])

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def centre(self) -> Array:
        """Mean pose (6,)."""
        return self.poses.mean(axis=0)

    @property
    def spread(self) -> Array:
        """Standard deviation of each pose parameter (6,), 1 where it does not vary."""
        spread = self.poses.std(axis=0)
        return np.where(spread > 1e-9, spread, 1.0)

    @property
    def ceiling(self) -> Array:
        """Largest value of each load (loads,): 0 for sensitive loads, which never pull."""
        return np.array([0.0 if name in self.scene.sensitive_loads else np.inf for name in self.load_names])

    @property
    def load_scale(self) -> tuple[Array, Array]:
        """Mean and standard deviation (L,) of the loads (1 where a load never varies)."""
        deviation = self.loads.std(axis=0)
        return self.loads.mean(axis=0), np.where(deviation > 0.0, deviation, 1.0)
