"""Weights and biases of a network as training sees them: one flat vector, layer after layer its matrix V_l
(n_l, n_{l-1} + 1) with the bias as last column. Also random networks to begin with, and wider ones to go on with."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.network import Network


def layer_shapes(inputs: int, hidden: tuple[int, ...], outputs: int = 1) -> tuple[tuple[int, int], ...]:
    """(neurons, inputs + 1) of each layer, the bias counted as an input."""
    sizes = (inputs, *hidden, outputs)
    return tuple((after, before + 1) for before, after in pairwise(sizes))


def initial_network(inputs: Array, targets: Array, hidden: tuple[int, ...], activation: str, seed: Any) -> Network:
    """Random weights N(0, 1/fan_in), biases U(-1, 1), on inputs standardised by the data; outputs in units of the
    targets' standard deviation, starting near their mean. A constant input or target has scale 1 (or its size).
    targets (n,), or (n, m) for several outputs."""
    rng = np.random.default_rng(seed)
    shift, scale = inputs.mean(axis=0), inputs.std(axis=0)
    scale = np.where(scale > 1e-12 * np.maximum(np.abs(shift), 1e-300), scale, 1.0)
    spread, mean = np.atleast_1d(targets.std(axis=0)), np.atleast_1d(targets.mean(axis=0))
    size = np.where(mean == 0.0, 1.0, np.abs(mean))
    output_scale = np.where((spread > 1e-12 * np.abs(mean)) & (spread > 0.0), spread, size)
    weights, biases = [], []
    for neurons, fan_in in ((n, k - 1) for n, k in layer_shapes(inputs.shape[1], hidden, len(spread))):
        weights.append(rng.normal(size=(neurons, fan_in)) / np.sqrt(fan_in))
        biases.append(rng.uniform(-1.0, 1.0, neurons))
    weights[-1] *= 0.1
    biases[-1][:] = mean / output_scale
    one_scale = output_scale if targets.ndim > 1 else float(output_scale[0])
    return Network(shift, scale, tuple(weights), tuple(biases), one_scale, activation)


def flatten(network: Network) -> Array:
    """Weights and biases as one vector, layer after layer, bias as last column."""
    layers = zip(network.weights, network.biases, strict=True)
    return np.concatenate([np.column_stack([w, b]).ravel() for w, b in layers])


def unflatten(parameters: Array, like: Network) -> Network:
    """The network with these parameters, of the sizes and scales of ``like``."""
    shapes = layer_shapes(len(like.input_shift), like.hidden, like.outputs)
    layers = [layer.copy() for layer in split(np.asarray(parameters), shapes)]
    weights, biases = tuple(v[:, :-1].copy() for v in layers), tuple(v[:, -1].copy() for v in layers)
    return Network(like.input_shift, like.input_scale, weights, biases, like.output_scale, like.activation)


def split(parameters: Array, shapes: tuple[tuple[int, int], ...]) -> list[Array]:
    """The layers (neurons, inputs + 1) in a vector of parameters, as views of it."""
    layers, start = [], 0
    for neurons, width in shapes:
        layers.append(parameters[start : start + neurons * width].reshape(neurons, width))
        start += neurons * width
    return layers


def check_sizes(sizes: Sequence[Sequence[int]]) -> tuple[tuple[int, ...], ...]:
    """The sizes to grow through; ValueError unless every one contains the one before it."""
    checked = tuple(tuple(int(n) for n in size) for size in sizes)
    if not checked or any(not size or min(size) < 1 for size in checked):
        raise ValueError(f"sizes is {sizes!r}, expected hidden layers of 1 neuron or more, as ((8,), (12, 12))")
    for small, large in pairwise(checked):
        contained = len(large) >= len(small) and all(b >= a for a, b in zip(small, large, strict=False))
        if not contained or small == large:
            raise ValueError(f"sizes go from {small} to {large}, expected each to be wider or deeper than the last")
    return checked


def widen(network: Network, hidden: tuple[int, ...], seed: Any) -> Network:
    """The same function on more neurons in as many layers: new neurons get random incoming and zero outgoing weights.

    A deeper network begins from random weights instead: with layers inserted as nearly linear maps σ(ε·a)/ε, training
    ended at 2 to 4 times the error.
    """
    rng = np.random.default_rng(seed)
    weights, biases = list(network.weights), list(network.biases)
    for level, wide in enumerate(hidden):
        new = wide - len(biases[level])
        fan_in = weights[level].shape[1]
        weights[level] = np.vstack([weights[level], rng.normal(size=(new, fan_in)) / np.sqrt(fan_in)])
        biases[level] = np.concatenate([biases[level], rng.uniform(-1.0, 1.0, new)])
        weights[level + 1] = np.hstack([weights[level + 1], np.zeros((len(weights[level + 1]), new))])
    return replace(network, weights=tuple(weights), biases=tuple(biases))
