"""A nonlinear autoregressive network with exogenous input (NARX): it sees two frames and the loads one frame ago.

    F_t = W·σ(V·(x_t, x_{t-1}, F_{t-1}) + b) + c

It is fitted with the true past loads (series-parallel) and used with its own (parallel), so that errors feed back. Past
loads are therefore given with noise in training: exact ones tell so much of the next that it would trust its own.
"""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.training_set import Limits

HIDDEN = 24
_ROUNDS_OF_REST = 30
_NOISE = 0.1  # of past loads in training, in their deviations

State = tuple[Array, Array]
"""Poses (n, 6) and loads (n, L) one frame ago."""


class Narx:
    """One network of all loads that is fed its own output."""

    def __init__(self, network: Network, mean_loads: Array, spread: Array, limits: Limits) -> None:
        self._network, self._mean, self._spread, self._limits = network, mean_loads, spread, limits
        self.parameter_count = network.parameter_count
        self.remark = f"2 frames and its own last loads, {HIDDEN} neurons for all loads"

    def rest(self, poses: Array) -> State:
        """The loads that it comes to from the motion's mean loads when it stays at the poses."""
        state = poses, np.tile(self._mean, (len(poses), 1))
        for _ in range(_ROUNDS_OF_REST):
            state = self.advance(state, poses)[0]
        return state

    def advance(self, state: State, poses: Array) -> tuple[State, Array]:
        """Poses and loads as the next state, and the loads (n, L)."""
        value = self._network.value(np.hstack([poses, *state])).reshape(len(poses), -1)
        loads = self._limits.hold(self._mean + self._spread * value)
        return (poses, loads), loads


def narx(cycles: Cycles, gflop: float) -> Narx:
    """The network of all loads, in shares of their spread, fitted by Levenberg-Marquardt on the true past."""
    poses, loads = cycles.poses, cycles.loads
    previous = np.maximum(np.arange(cycles.frames) - 1, 0)
    noise = _NOISE * cycles.spread * np.random.default_rng(0).normal(size=loads.shape)
    past = poses[:, previous], loads[:, previous] + noise
    inputs = np.concatenate([poses, *past], axis=2).reshape(len(cycles.validation), -1)
    targets = ((loads - cycles.centre) / cycles.spread).reshape(len(inputs), -1)
    targets = targets[:, 0] if targets.shape[1] == 1 else targets
    regression = Regression("all loads", inputs, targets, np.ones(targets.shape), cycles.validation, 0.0)
    network = fit(regression, TrainingSettings(sizes=((HIDDEN,),), max_gflop=gflop)).network
    return Narx(network, cycles.centre, cycles.spread, cycles.limits)
