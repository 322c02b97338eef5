"""The growth rule of §2.6: start small; if the error's trend misses the wanted error, add neurons, then layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.networks.network import Network


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


def widen(network: Network, hidden: tuple[int, ...], seed: Any) -> Network:
    """The same function on more neurons in as many layers: new neurons get random incoming and zero outgoing weights.

    Raises ValueError for another number of layers. A deeper network is not begun from a shallower one: layers
    inserted as nearly linear maps σ(ε·a)/ε keep the function too, but for any ε training then ended at 2 to 4 times
    the error of a deeper network begun from random weights.
    """
    if len(hidden) != len(network.hidden):
        raise ValueError(f"cannot widen {network.hidden} to {hidden}, expected as many layers")
    check_ladder((network.hidden, hidden))
    rng = np.random.default_rng(seed)
    weights, biases = list(network.weights), list(network.biases)
    for level, wide in enumerate(hidden):
        new = wide - len(biases[level])
        fan_in = weights[level].shape[1]
        weights[level] = np.vstack([weights[level], rng.normal(size=(new, fan_in)) / np.sqrt(fan_in)])
        biases[level] = np.concatenate([biases[level], rng.uniform(-1.0, 1.0, new)])
        weights[level + 1] = np.hstack([weights[level + 1], np.zeros((len(weights[level + 1]), new))])
    return replace(network, weights=tuple(weights), biases=tuple(biases))
