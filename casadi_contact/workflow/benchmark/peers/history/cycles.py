"""What history models learn from: cycles in order, with the loads of the teacher's contact model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.workflow.benchmark.peers.training_set import Limits, TrainingSet

VALIDATION_SHARE = 0.15


@dataclass(frozen=True)
class Cycles:
    """poses (cycles, frames, 6) [mm, rad] and loads (cycles, frames, L) [N, N·mm] of ``load_names``.

    held_back: how many of the last cycles only judge a fit. centre, spread (L,): mean and standard deviation of the
    loads; limits: see `TrainingSet`.
    """

    load_names: tuple[str, ...]
    poses: Array
    loads: Array
    held_back: int
    centre: Array
    spread: Array
    limits: Limits

    @classmethod
    def of(cls, data: TrainingSet, motion: ReferenceMotion | None) -> Cycles:
        """The motion's frames with the loads of the scene's teacher grid.

        Raises ValueError without a motion of at least 2 cycles.
        """
        if motion is None or len(motion.poses) < 2:
            raise ValueError(
                "a history model learns from cycles in order: give the reference motion, of at least 2 cycles"
            )
        teacher = ElasticFoundation(data.scene, data.scene.grids["teacher"])
        columns = [teacher.load_names.index(name) for name in data.load_names]
        loads = teacher(motion.poses.reshape(-1, 6))[:, columns].reshape(*motion.poses.shape[:2], -1)
        held_back = max(1, round(VALIDATION_SHARE * len(loads)))
        flat = loads[:-held_back].reshape(-1, loads.shape[2])
        deviation = flat.std(axis=0)
        spread = np.where(deviation > 0.0, deviation, 1.0)
        return cls(data.load_names, motion.poses, loads, held_back, flat.mean(axis=0), spread, data.limits)

    @property
    def frames(self) -> int:
        """Frames of a cycle."""
        return self.poses.shape[1]

    @property
    def learned(self) -> tuple[Array, Array]:
        """Poses and loads of the cycles that are fitted."""
        return self.poses[: -self.held_back], self.loads[: -self.held_back]

    @property
    def judged(self) -> tuple[Array, Array]:
        """Poses and loads of the cycles that are held back."""
        return self.poses[-self.held_back :], self.loads[-self.held_back :]

    @property
    def validation(self) -> np.ndarray:
        """True for the frames (cycles·frames,) of the cycles that are held back."""
        return np.repeat(np.arange(len(self.poses)) >= len(self.poses) - self.held_back, self.frames)
