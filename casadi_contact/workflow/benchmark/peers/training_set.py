"""What every peer is fitted on: the training samples, shuffled, with scaled inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.sample_rows import finite, fitted_rows


@dataclass(frozen=True)
class Limits:
    """Least and largest value (L,) of each load: contact cannot pull, so a predicted pulling force is clamped to zero,
    as the paper does [EF15 §3.5]. Loads that press in no single direction have no limits."""

    floor: Array
    ceiling: Array

    @classmethod
    def of(cls, scene: Scene, load_names: Sequence[str]) -> Limits:
        """Of a scene's normal loads with a direction: zero on the side that would pull."""
        signs = {normal.loads[0]: normal.sign for normal in scene.normal_loads if normal.component is not None}
        pressing = np.array([signs.get(name, 0.0) for name in load_names])
        return cls(np.where(pressing > 0.0, 0.0, -np.inf), np.where(pressing < 0.0, 0.0, np.inf))

    @cached_property
    def _steps(self) -> list[tuple[np.ufunc, Array]]:
        both = ((np.minimum, self.ceiling), (np.maximum, self.floor))
        return [(clamp, bound) for clamp, bound in both if np.isfinite(bound).any()]

    @property
    def remark(self) -> str:
        """What a candidate's remark says of them."""
        return ", pulling forces clamped to zero" if self._steps else ""

    def hold(self, loads: Array) -> Array:
        """The loads (..., L) themselves, clamped in place."""
        for clamp, bound in self._steps:
            clamp(loads, bound, out=loads)
        return loads

    def beyond(self, loads: Array) -> np.ndarray:
        """True (..., L) where loads are clamped."""
        return np.asarray((loads > self.ceiling) | (loads < self.floor))


@dataclass(frozen=True)
class TrainingSet:
    """Training rows in random order, so that the first n are a fair choice of n.

    poses (n, 6), loads (n, L) of ``load_names``; validation_poses (m, 6) alike. centre and spread (6,) are
    mean and standard deviation of the training poses (spread 1 where a parameter never varies).
    """

    scene: Scene
    load_names: tuple[str, ...]
    poses: Array
    loads: Array
    validation_poses: Array

    @classmethod
    def of(cls, samples: Samples, names: Sequence[str] | None = None, seed: int = 0) -> TrainingSet:
        """The training and validation samples; raises ValueError for an unknown load, NaN or no training samples."""
        names = tuple(samples.scene.load_names if names is None else names)
        rows, validation = fitted_rows(samples)
        poses, loads = finite("poses", samples.poses[rows]), finite("loads", samples.loads(names)[rows])
        order = np.random.default_rng(seed).permutation(np.flatnonzero(~validation))
        return cls(samples.scene, names, poses[order], loads[order], poses[validation])

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
    def limits(self) -> Limits:
        """What the loads may be at most and at least."""
        return Limits.of(self.scene, self.load_names)

    @property
    def load_scale(self) -> tuple[Array, Array]:
        """Mean and standard deviation (L,) of the loads (1 where a load never varies)."""
        deviation = self.loads.std(axis=0)
        return self.loads.mean(axis=0), np.where(deviation > 0.0, deviation, 1.0)
