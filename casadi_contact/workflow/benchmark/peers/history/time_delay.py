"""A time-delay network: it sees the current and the past frames of a cycle.

F_t = Σ_j v_j·σ(w_jᵀ(x_t, x_{t-1}, x_{t-2}) + b_j) + c
"""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.training_set import Limits

FRAMES_SEEN = 3
HIDDEN = 12


def with_history(cycles: Array, frames_seen: int = FRAMES_SEEN) -> Array:
    """Inputs (cycles, frames, 6·frames_seen) from poses (cycles, frames, 6): the current frame first, then the past.

    The first frame of a cycle stands in for the past that is not there.
    """
    frames = np.arange(cycles.shape[1])
    return np.concatenate([cycles[:, np.maximum(frames - d, 0)] for d in range(frames_seen)], axis=2)


class DelayNetworks:
    """One network of one hidden layer per load, evaluated as two matrix products for all loads together.

    A state is the poses seen last, (n, 6·FRAMES_SEEN), the latest first.
    """

    def __init__(self, networks: list[Network], limits: Limits) -> None:
        hidden = [len(network.biases[0]) for network in networks]
        first = networks[0]
        if any(len(n.weights) != 2 or n.activation != first.activation for n in networks):
            raise ValueError(
                "the networks differ in layers or activation, expected one hidden layer and one activation"
            )
        self._limits, self._sigma = limits, activation_of(first.activation).derivatives
        # The scaling of the inputs is folded into the weights, each network's own.
        scaled = [n.weights[0] / n.input_scale for n in networks]
        self._weights = np.vstack(scaled)
        self._biases = np.concatenate([n.biases[0] - w @ n.input_shift for n, w in zip(networks, scaled, strict=True)])
        self._output = np.zeros((len(networks), sum(hidden)))
        ends = np.cumsum(hidden)
        for row, (network, end, width) in enumerate(zip(networks, ends, hidden, strict=True)):
            self._output[row, end - width : end] = network.output_scale * network.weights[1][0]
        self._constant = np.array([n.output_scale * n.biases[1][0] for n in networks])
        self.parameter_count = sum(n.parameter_count for n in networks)
        self.remark = f"{FRAMES_SEEN} frames, {HIDDEN} neurons a load"

    def rest(self, poses: Array) -> Array:
        """The pose as its own past."""
        return np.tile(poses, (1, FRAMES_SEEN))

    def advance(self, state: Array, poses: Array) -> tuple[Array, Array]:
        """The poses seen last, and the loads (n, L)."""
        state = np.hstack([poses, state[:, :-6]])
        (hidden,) = self._sigma(np, state @ self._weights.T + self._biases, 0)
        return state, self._limits.hold(hidden @ self._output.T + self._constant)


def time_delay(cycles: Cycles, gflop: float) -> DelayNetworks:
    """Networks of single loads, fitted by Levenberg-Marquardt; the cycles that are held back stop the training."""
    inputs = with_history(cycles.poses).reshape(-1, 6 * FRAMES_SEEN)
    loads = cycles.loads.reshape(len(inputs), -1)
    settings = TrainingSettings(sizes=((HIDDEN,),), max_gflop=gflop / len(cycles.load_names))
    ones = np.ones(len(inputs))
    return DelayNetworks(
        [
            fit(Regression(name, inputs, loads[:, k], ones, cycles.validation, 0.0), settings).network
            for k, name in enumerate(cycles.load_names)
        ],
        cycles.limits,
    )
