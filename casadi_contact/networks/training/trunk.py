"""A network of several outputs in training: the products of `mlp`, at about the price of one output.

With residuals r_k = w_k·(y_k - target_k) for every row and output k, and W_l the matrix V_l without its bias column,
the products go through the layers forwards and backwards instead of through ∂r/∂z_l, of which there are now several:

    J·v:   ȧ_0 = 0,   ż_l = V̇_l·ã_{l-1} + W_l·ȧ_{l-1},   ȧ_l = σ'(z_l) * ż_l,   (J·v)_k = w_k·ẏ_k
    Jᵀ·u:  δ_L = w * u,   δ_{l-1} = (W_lᵀ·δ_l) * σ'(z_{l-1}),   ∂/∂V_l = δ_l·ã_{l-1}ᵀ
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.networks.training.chunk import Chunk, Factors
from casadi_contact.networks.training.mlp import Mlp
from casadi_contact.networks.training.weights import split


class TrunkMlp(Mlp):
    """Residuals of one network of m outputs, targets and weights (rows, m); otherwise as `Mlp`."""

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return self.outputs

    def _output(self, a: Any, layer: Any) -> Any:
        return (layer @ a).T

    def _output_step(self, weight: Any, residuals: Any) -> Any | None:
        steps = [self._least_squares(weight[:, k], residuals[:, k]) for k in range(self.outputs)]
        return None if any(step is None for step in steps) else self.xp.stack(steps)

    def _derivatives(self, chunk: Chunk, layers: list[Any]) -> list[Any]:
        """σ' of hidden layers, and the head: what takes a change of the outputs to the residuals of a row."""
        return [*(chunk.slope(level) for level in range(len(layers) - 1)), self._head(chunk, layers[-1])]

    def _head(self, chunk: Chunk, layer: Any) -> Any:
        """w (outputs, rows)."""
        return self._weight[chunk.rows].T

    def _rough(self, exact: Factors) -> Factors:
        single, (*slopes, head) = self.arrays.single, exact.derivatives
        derivatives = [*(single(slope) for slope in slopes), single(head * (1.0 / self._unit))]
        return Factors([single(a) for a in exact.inputs], derivatives, [single(layer) for layer in exact.layers])

    def _of_outputs(self, tangent: Any, head: Any) -> Any:
        """Change of the residuals with that of the outputs (outputs, rows)."""
        return (tangent * head).T

    def _by_outputs(self, rows: Any, head: Any) -> Any:
        """Jᵀ·u at the outputs (outputs, rows)."""
        return rows.T * head

    def _seeds(self, rows: np.ndarray) -> Any:
        """∂r/∂y (len(rows), residuals of a row, outputs)."""
        weight = self._weight[rows]
        seeds = self.arrays.zeros(len(weight), self.outputs, self.outputs)
        for k in range(self.outputs):
            seeds[:, k, k] = weight[:, k]
        return seeds

    def _forward_product(self, of: Factors, layers: list[Any]) -> Any:
        *slopes, head = of.derivatives
        tangent = layers[0] @ of.inputs[0]
        for level, slope in enumerate(slopes, start=1):
            tangent *= slope
            tangent = layers[level] @ of.inputs[level] + of.layers[level][:, :-1] @ tangent
        return self._of_outputs(tangent, head)

    def _add_reverse_product(self, total: Any, of: Factors, rows: Any) -> None:
        *slopes, head = of.derivatives
        layers, delta = split(total, self.shapes), self._by_outputs(rows, head)
        for level in range(len(layers) - 1, -1, -1):
            layers[level] += delta @ of.inputs[level].T
            if level:
                delta = (of.layers[level][:, :-1].T @ delta) * slopes[level - 1]

    def jacobian(self, rows: Any, out: Any | None = None) -> Any:
        """Rows of J, the residuals of each below each other (len(rows)·m, parameters)."""
        index = np.arange(self.rows)[rows]
        delta, layers = self._seeds(index), self._chunks[0].exact.layers
        count = len(delta) * self.per_row
        out = self.arrays.empty(count, self.parameter_count) if out is None else out[:count]
        end = self.parameter_count
        for level in range(len(self.shapes) - 1, -1, -1):
            neurons, width = self.shapes[level]
            a = self._columns(index, lambda chunk, level=level: chunk.exact.inputs[level])
            block = self.xp.einsum("nkj,in->nkji", delta, a)
            out[:, end - neurons * width : end] = block.reshape(count, -1)
            end -= neurons * width
            if level:
                slope = self._columns(index, lambda chunk, level=level: chunk.exact.derivatives[level - 1])
                delta = (delta @ layers[level][:, :-1]) * slope.T[:, None]
        return out
