"""Rows of the data in training: the loss of each, blocks of them that fit into the processor's cache, random subsets.

A row with target t, weight w and false load f (see `network.Regression`) has two residuals,

    r = w·(y - t),   e = f·max(y, 0)².

Both depend on the network's output y alone, so that the gradient and JᵀJ of ½Σ(r² + e²) are those of one residual R
with ∂R/∂y = W,

    W² = w² + (∂e/∂y)²,   W·R = w·r + ∂e/∂y·e,   ∂e/∂y = 2f·max(y, 0).

They are not added before they are squared: with a large r, Gauss-Newton would not see how stiff e is at y = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import Activation


@dataclass(frozen=True)
class RowLoss:
    """target, weight and false_load, each (rows,) or (rows, outputs); false_load is None where it is 0 in all rows."""

    target: Array
    weight: Array
    false_load: Array | None

    def squares(self, y: Array) -> Array:
        """r² + e²."""
        squares = (self.weight * (y - self.target)) ** 2
        return squares if self.false_load is None else squares + (self.false_load * y.clip(min=0.0) ** 2) ** 2

    def weight_and_residual(self, y: Array) -> tuple[Array, Array]:
        """W and R."""
        residual = self.weight * (y - self.target)
        if self.false_load is None:
            return self.weight, residual
        pressed = y.clip(min=0.0)
        excess, steepness = self.false_load * pressed**2, 2.0 * self.false_load * pressed
        weight = (self.weight**2 + steepness**2) ** 0.5
        return weight, (self.weight * residual + steepness * excess) / weight.clip(min=np.finfo(float).tiny)


@dataclass(frozen=True)
class Factors:
    """What products with J at the current parameters are made of, in one precision.

    inputs: ã_{l-1} (inputs + 1, rows) of each layer. derivatives: for each layer the factor between a change of its z
    and the residuals (`Mlp`: δ_l; `SeveralOutputsMlp`: σ' of hidden layers, w of the last one). layers: V_l.
    """

    inputs: Sequence[np.ndarray]
    derivatives: Sequence[np.ndarray]
    layers: Sequence[np.ndarray]


class Block:
    """Activations of some rows, a column for each, at the parameters tried last and at the current ones."""

    exact: Factors
    rough: Factors

    def __init__(self, activation: Activation, inputs: Array, hidden: Sequence[int], rows: slice) -> None:
        self._activation, self.rows = activation, rows
        self._first, self._hidden = np.ascontiguousarray(inputs), hidden
        self.tried, self.current = self._buffers(), self._buffers()

    def _buffers(self) -> list[Array]:
        """ã of every layer's input, the constant row of ones set once."""
        buffers = [self._first]
        for neurons in self._hidden:
            buffer = np.empty((neurons + 1, self.rows.stop - self.rows.start))
            buffer[-1] = 1.0
            buffers.append(buffer)
        return buffers

    def run(self, layers: Sequence[Array]) -> None:
        """Fill ``tried`` with the activations of the hidden layers."""
        for layer, before, after in zip(layers[:-1], self.tried[:-1], self.tried[1:], strict=True):
            after[:-1] = self._activation.derivatives(np, layer @ before, 0)[0]

    def activation_slope(self, level: int) -> Array:
        """σ' (neurons, rows) of hidden layer ``level``, at the current parameters."""
        return np.asarray(self._activation.slope_from_value(np, self.current[level + 1][:-1]))


def draw_rows(weights: Array, count: int, seed: Sequence[int]) -> tuple[np.ndarray, Array]:
    """About `count` rows drawn with probability ∝ their weight, and a scale for each, so that JᵀJ of the scaled rows
    has the expectation of JᵀJ of all; all rows where there are no more."""
    if count >= len(weights) or not weights.sum() > 0.0:
        return np.arange(len(weights)), np.ones(len(weights))
    chance = np.minimum(1.0, weights * (count / weights.sum()))
    drawn = np.flatnonzero(np.random.default_rng(seed).random(len(weights)) < chance)
    return drawn, 1.0 / np.sqrt(chance[drawn])
