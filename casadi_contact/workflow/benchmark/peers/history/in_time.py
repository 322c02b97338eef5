"""History models as load models: along cycles, and on single poses that have no past."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from casadi_contact.core.conventions import Array, as_poses


class HistoryModel(Protocol):
    """Loads of n motions at a time, one frame after the other; a state is what a model remembers of the past."""

    parameter_count: int
    remark: str

    def rest(self, poses: Array) -> Any:
        """The state of motions that have rested at their poses (n, 6)."""

    def advance(self, state: Any, poses: Array) -> tuple[Any, Array]:
        """The next state, and the loads (n, L) at the next frame's poses (n, 6)."""


def follow(model: HistoryModel, cycles: Array) -> Array:
    """Loads (cycles, frames, L) of poses (cycles, frames, 6); each cycle begins at rest."""
    state, loads = model.rest(cycles[:, 0]), []
    for frame in range(cycles.shape[1]):
        state, row = model.advance(state, cycles[:, frame])
        loads.append(row)
    return np.stack(loads, axis=1)


class InSequence:
    """Loads of poses (n, 6) that follow each other as the frames of whole cycles (or of one piece of a cycle)."""

    def __init__(self, model: HistoryModel, load_names: tuple[str, ...], frames: int) -> None:
        self.load_names, self._model, self._frames = load_names, model, frames
        self._state: Any = None

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        poses = as_poses(poses)
        frames = self._frames if len(poses) % self._frames == 0 else len(poses)
        return follow(self._model, poses.reshape(-1, frames, 6)).reshape(len(poses), -1)

    def one(self, pose: Array) -> Array:
        """Loads (L) of the next frame; the frames before it are remembered."""
        poses = np.reshape(pose, (1, 6))
        state = self._model.rest(poses) if self._state is None else self._state
        self._state, loads = self._model.advance(state, poses)
        return loads[0]


class SinglePoses:
    """Loads of poses (n, 6) that know no past: a motion that has rested at each stands in for it."""

    def __init__(self, model: HistoryModel, load_names: tuple[str, ...]) -> None:
        self.load_names, self._model = load_names, model

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        poses = as_poses(poses)
        return self._model.advance(self._model.rest(poses), poses)[1]

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose."""
        return self(np.reshape(pose, (1, 6)))[0]
