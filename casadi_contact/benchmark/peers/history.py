"""A history model: a time-delay network that sees the current and the past frames of a cycle.

    F_t = Σ_j v_j·σ(w_jᵀ(x_t, x_{t-1}, x_{t-2}) + b_j) + c

Such models follow a motion like those they were trained on, in order. Contact loads here depend on the pose alone;
what the past adds is knowledge of the motion. An optimiser asks for single poses, which have no past: then the pose
stands in for its own past.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from casadi_contact.activations import activation_of
from casadi_contact.benchmark.candidate import Candidate
from casadi_contact.benchmark.peers.stopwatch import one_call, single_calls
from casadi_contact.benchmark.peers.training_set import TrainingSet
from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array, as_poses
from casadi_contact.network import Network, Regression
from casadi_contact.sampling import ReferenceMotion
from casadi_contact.training import TrainingSettings, fit

FAMILY = "time-delay network"
FRAMES_SEEN = 3
HIDDEN = 12
VALIDATION_SHARE = 0.15


def with_history(cycles: Array, frames_seen: int = FRAMES_SEEN) -> Array:
    """Inputs (cycles, frames, 6·frames_seen) from poses (cycles, frames, 6): the current frame first, then the past.

    The first frame of a cycle stands in for the past that is not there.
    """
    frames = np.arange(cycles.shape[1])
    return np.concatenate([cycles[:, np.maximum(frames - d, 0)] for d in range(frames_seen)], axis=2)


class DelayNetworks:
    """One network of one hidden layer per load, evaluated as two matrix products for all loads together."""

    def __init__(self, networks: list[Network], ceiling: Array) -> None:
        hidden = [len(network.biases[0]) for network in networks]
        first = networks[0]
        if any(len(n.weights) != 2 or n.activation != first.activation for n in networks):
            raise ValueError(
                "the networks differ in layers or activation, expected one hidden layer and one activation"
            )
        self._ceiling, self._sigma = ceiling, activation_of(first.activation).derivatives
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

    def __call__(self, inputs: Array) -> Array:
        """Loads (..., L) of inputs (..., 6·frames)."""
        (hidden,) = self._sigma(np, inputs @ self._weights.T + self._biases, 0)
        return np.minimum(hidden @ self._output.T + self._constant, self._ceiling)


class InSequence:
    """Loads of poses (n, 6) that follow each other as the frames of whole cycles (or of one piece of a cycle)."""

    def __init__(self, networks: DelayNetworks, load_names: tuple[str, ...], frames: int) -> None:
        self.load_names, self._networks, self._frames = load_names, networks, frames
        self._input = np.zeros(6 * FRAMES_SEEN)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        poses = as_poses(poses)
        whole = len(poses) % self._frames == 0
        cycles = poses.reshape(-1, self._frames if whole else len(poses), 6)
        return self._networks(with_history(cycles)).reshape(len(poses), -1)

    def one(self, pose: Array) -> Array:
        """Loads (L) of the next frame; the frames before it are remembered."""
        self._input[6:] = self._input[:-6].copy()
        self._input[:6] = pose
        return self._networks(self._input)


class SinglePoses:
    """Loads of poses (n, 6) that know no past: each pose stands in for its own."""

    def __init__(self, networks: DelayNetworks, load_names: tuple[str, ...]) -> None:
        self.load_names, self._networks = load_names, networks
        self._input = np.zeros((FRAMES_SEEN, 6))

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return self._networks(np.tile(as_poses(poses), (1, FRAMES_SEEN)))

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose."""
        self._input[:] = pose
        return self._networks(self._input.ravel())


def history(data: TrainingSet, gflop: float, motion: ReferenceMotion | None) -> Iterator[Candidate]:
    """Time-delay networks trained on the motion's cycles, in sequence and on single poses.

    The samples have no order in time, so this peer alone is trained on the reference motion's frames, with the
    teacher's loads. Some whole cycles are held back to stop training. Raises ValueError without a motion of at least
    2 cycles.
    """
    if motion is None or len(motion.poses) < 2:
        raise ValueError("a history model learns from cycles in order: give the reference motion, of at least 2 cycles")
    count, frames = motion.poses.shape[:2]
    began = time.process_time()
    teacher = ElasticFoundation(data.scene, data.scene.grids["teacher"])
    columns = [teacher.load_names.index(name) for name in data.load_names]
    loads = teacher(motion.poses.reshape(-1, 6))[:, columns]
    inputs = with_history(motion.poses).reshape(count * frames, -1)
    held = max(1, round(VALIDATION_SHARE * count))
    validation = np.repeat(np.arange(count) >= count - held, frames)
    settings = TrainingSettings(sizes=((HIDDEN,),), max_gflop=gflop / len(data.load_names))
    networks = DelayNetworks(
        [
            fit(Regression(name, inputs, loads[:, k], np.ones(len(inputs)), validation, 0.0), settings).network
            for k, name in enumerate(data.load_names)
        ],
        data.ceiling,
    )
    took = time.process_time() - began
    # The cycles that stopped the training: the same frames once with and once without their past.
    held_back, wanted = motion.poses[count - held :].reshape(-1, 6), loads[validation]
    models: tuple[InSequence | SinglePoses, ...] = (
        InSequence(networks, data.load_names, frames),
        SinglePoses(networks, data.load_names),
    )
    share = [float(np.mean(((m(held_back) - wanted) / data.load_scale[1]) ** 2) ** 0.5) for m in models]
    for model, what in zip(models, ("in sequence", "single poses"), strict=True):
        yield Candidate(
            f"{FAMILY}, {what}",
            FAMILY,
            model,
            time_value=single_calls(model.one),
            time_batch=one_call(model),
            samples=int((~validation).sum()),
            training_seconds=took,
            parameters=networks.parameter_count,
            remark=(
                f"{FRAMES_SEEN} frames, {HIDDEN} neurons a load, knows only the reference motion; RMS error on "
                f"its validation cycles in shares of the loads' deviation: {share[0]:.4f} in sequence, "
                f"{share[1]:.4f} on single poses"
            ),
        )
