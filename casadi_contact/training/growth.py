"""The growth rule of §2.6: start small; if the error's trend misses the wanted error, add neurons, then layers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import Array
from casadi_contact.network import Network

# A layer put between two others starts as a nearly linear map σ(ε·a)/ε; smaller is closer to a but worse conditioned.
_LINEAR_PART = 0.1


def extrapolated_error(effort: ArrayLike, rms: ArrayLike, end: float) -> float:
    """The error to expect at ``end``: log(rms) as a line in log(effort) through the latter half of the entries.

    Effort is the time (or iterations) since this size began, all > 0: errors of these fits fall like a power of it.
    The line never rises: a trend upwards counts as standing still.
    """
    effort, rms = np.asarray(effort, dtype=float), np.asarray(rms, dtype=float)
    half = len(rms) // 2
    x, y = np.log(effort[half:]), np.log(np.maximum(rms[half:], 1e-300))
    if len(x) < 2 or np.ptp(x) == 0.0:
        return float(rms[-1])
    slope = min(float(np.polyfit(x, y, 1)[0]), 0.0)
    return float(rms[-1]) * (end / float(effort[-1])) ** slope if end > effort[-1] else float(rms[-1])


def will_reach(effort: ArrayLike, rms: ArrayLike, end: float, tolerance: float) -> bool:
    """True if the trend comes down to the tolerance before ``end``."""
    return extrapolated_error(effort, rms, end) <= tolerance


def check_ladder(sizes: Sequence[Sequence[int]]) -> tuple[tuple[int, ...], ...]:
    """The sizes to grow through; ValueError unless every one contains the one before it."""
    ladder = tuple(tuple(int(n) for n in size) for size in sizes)
    if not ladder or any(not size or min(size) < 1 for size in ladder):
        raise ValueError(
            f"sizes is {sizes!r}, expected hidden layers such as ((8,), (12, 12)), each of 1 neuron or more"
        )
    for small, large in pairwise(ladder):
        contained = len(large) >= len(small) and all(b >= a for a, b in zip(small, large, strict=False))
        if not contained or small == large:
            raise ValueError(
                f"sizes go from {small} to {large}, expected each to be wider or deeper than the one before"
            )
    return ladder


def grow(network: Network, hidden: tuple[int, ...], seed: Any) -> Network:
    """The same function on more neurons: widened, then deepened, to the sizes ``hidden``.

    New neurons get random incoming and zero outgoing weights, so widening keeps the function exactly. A new layer
    behind the last hidden one passes its input on as σ(ε·a)/ε, which keeps the function up to O(ε²).
    """
    check_ladder((network.hidden, hidden))
    rng = np.random.default_rng(seed)
    weights, biases = list(network.weights), list(network.biases)
    for level, wide in enumerate(hidden[: len(network.hidden)]):
        new = wide - len(biases[level])
        fan_in = weights[level].shape[1]
        weights[level] = np.vstack([weights[level], rng.normal(size=(new, fan_in)) / np.sqrt(fan_in)])
        biases[level] = np.concatenate([biases[level], rng.uniform(-1.0, 1.0, new)])
        weights[level + 1] = np.hstack([weights[level + 1], np.zeros((len(weights[level + 1]), new))])
    for wide in hidden[len(network.hidden) :]:
        _deepen(weights, biases, wide, rng)
    return Network(
        network.input_shift,
        network.input_scale,
        tuple(weights),
        tuple(biases),
        network.output_scale,
        network.activation,
    )


def _deepen(weights: list[Array], biases: list[Array], wide: int, rng: np.random.Generator) -> None:
    """Insert a hidden layer before the output. With room for every neuron each is passed on by one; else one new
    neuron passes on their weighted sum, which is all that the output sees."""
    before, output = weights[-1].shape[1], weights[-1][0]
    new = rng.normal(size=(wide, before)) / np.sqrt(before)
    new_bias = rng.uniform(-1.0, 1.0, wide)
    outgoing = np.zeros(wide)
    kept = before if wide >= before else 1
    passed = np.eye(before) if kept == before else output[None, :] / max(float(np.abs(output).sum()), 1e-300)
    new[:kept], new_bias[:kept] = _LINEAR_PART * passed, 0.0
    outgoing[:kept] = (output if kept == before else max(float(np.abs(output).sum()), 1e-300)) / _LINEAR_PART
    weights[-1:] = [new, outgoing[None, :]]
    biases[-1:] = [new_bias, biases[-1]]
