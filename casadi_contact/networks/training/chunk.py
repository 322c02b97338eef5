"""Rows of a network in training, as many as fit into the processor's cache: every array has a column for each row.

Walked through layer by layer they stay in the cache; columns make each row of an array one run of numbers, which
matrix products and sums read twice as fast as rows of 17 numbers or so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from casadi_contact.networks.activations import Activation
from casadi_contact.networks.training.arrays import NumpyArrays


@dataclass(frozen=True)
class Factors:
    """What products with J at the current parameters are made of, in one precision.

    inputs: ã_{l-1} (inputs + 1, rows) of each layer. derivatives: for each layer what takes a change of its z to the
    residuals, or back (`mlp`: δ_l; `trunk`: σ' of hidden layers, and the head of the last one). layers: V_l.
    """

    inputs: Sequence[Any]
    derivatives: Sequence[Any]
    layers: Sequence[Any]


class Chunk:
    """Activations of some rows, at the parameters that were tried last and at the current ones."""

    def __init__(
        self, arrays: NumpyArrays, activation: Activation, inputs: Any, hidden: Sequence[int], rows: slice
    ) -> None:
        self._arrays, self._activation, self.rows = arrays, activation, rows
        self._first, self._hidden = arrays.array(inputs), hidden
        self.tried, self.current = self._buffers(), self._buffers()
        self.exact: Factors
        self.rough: Factors

    def __len__(self) -> int:
        return self.rows.stop - self.rows.start

    def _buffers(self) -> list[Any]:
        """ã of every layer's input, the constant row of ones set once."""
        buffers = [self._first]
        for neurons in self._hidden:
            buffer = self._arrays.empty(neurons + 1, len(self))
            buffer[-1] = 1.0
            buffers.append(buffer)
        return buffers

    def run(self, layers: Sequence[Any], into: list[Any] | None = None) -> Any:
        """Fill ``into`` (``tried``) with what the hidden layers give; returns ã of the output layer."""
        values = self.tried if into is None else into
        for layer, before, after in zip(layers[:-1], values[:-1], values[1:], strict=True):
            after[:-1] = self._activation.derivatives(self._arrays.xp, layer @ before, 0)[0]
        return values[-1]

    def run_apart(self, layers: Sequence[Any]) -> Any:
        """ã of the output layer, without touching what was tried."""
        return self.run(layers, self._buffers())

    def swap(self) -> None:
        """Make what was tried last current."""
        self.current, self.tried = self.tried, self.current

    def slope(self, level: int) -> Any:
        """σ' (neurons, rows) behind layer ``level``, at the current parameters."""
        return self._activation.slope_from_value(self._arrays.xp, self.current[level + 1][:-1])
