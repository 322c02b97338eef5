"""The plain-array feed-forward network: what training produces and every surrogate evaluates.

Fully connected, sigmoidal hidden neurons, one linear output neuron (§2.6):

    a_0 = (x - input_shift) / input_scale,   a_l = σ(W_l a_{l-1} + b_l),   y = output_scale·(W_L a_{L-1} + b_L)

with σ(z) = z/√(1+z²) ("algebraic") or tanh z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array

ACTIVATIONS = ("algebraic", "tanh")


def activate(z: Array, activation: str) -> tuple[Array, Array]:
    """σ(z) and its slope σ'(z), elementwise."""
    if activation == "algebraic":
        r = 1.0 / np.sqrt(1.0 + z * z)
        return z * r, r * r * r
    a = np.tanh(z)
    return a, 1.0 - a * a


@dataclass(frozen=True)
class Network:
    """Weights of one network with k inputs: weights[l] has shape (n_l, n_{l-1}), biases[l] shape (n_l,)."""

    input_shift: Array
    input_scale: Array
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    output_scale: float = 1.0
    activation: str = "algebraic"

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"unknown activation {self.activation!r}, expected one of {', '.join(ACTIVATIONS)}")
        width = len(self.input_shift)
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (len(bias), width):
                raise ValueError(f"layer {layer} has weights {weight.shape}, expected {(len(bias), width)}")
            width = len(bias)
        if width != 1 or len(self.input_scale) != len(self.input_shift):
            raise ValueError(f"network ends in {width} neurons, expected one linear output and one scale per input")

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons per hidden layer, for example (32, 32)."""
        return tuple(len(bias) for bias in self.biases[:-1])

    @property
    def parameter_count(self) -> int:
        """Number of trained weights and biases."""
        return sum(w.size + b.size for w, b in zip(self.weights, self.biases, strict=True))

    def value(self, inputs: Array) -> Array:
        """y of shape (n,) for inputs of shape (n, k)."""
        a = (inputs - self.input_shift) / self.input_scale
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            a = activate(a @ weight.T + bias, self.activation)[0]
        return self.output_scale * (a @ self.weights[-1][0] + self.biases[-1][0])

    def value_and_gradient(self, inputs: Array) -> tuple[Array, Array]:
        """y (n,) and dy/dx (n, k), by one forward and one reverse pass."""
        a = (inputs - self.input_shift) / self.input_scale
        slopes = []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            a, slope = activate(a @ weight.T + bias, self.activation)
            slopes.append(slope)
        y = self.output_scale * (a @ self.weights[-1][0] + self.biases[-1][0])
        reverse = np.broadcast_to(self.output_scale * self.weights[-1][0], a.shape)
        for weight, slope in zip(self.weights[-2::-1], slopes[::-1], strict=True):
            reverse = (reverse * slope) @ weight
        return y, reverse / self.input_scale


@dataclass(frozen=True)
class Regression:
    """One network to fit: residual_i = weights_i·(net(inputs_i) - targets_i), root mean square wanted below tolerance.

    inputs (n, k); targets, weights (n,); validation (n,) is True for the rows that may stop training but never
    steer it (§2.6, criterion 3). Weights turn residuals into the unit of the tolerance (N or N·mm).
    """

    name: str
    inputs: Array
    targets: Array
    weights: Array
    validation: np.ndarray
    tolerance: float
