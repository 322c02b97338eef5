"""A network of several outputs in training: the products of `mlp`, at about the price of one output.

With residuals r_k = w_k·(y_k - target_k) for every row and output k, and W_l the matrix V_l without its bias column,
the products go through the layers forwards and backwards instead of through ∂r/∂z_l, of which there are now several:

    J·v:   ȧ_0 = 0,   ż_l = V̇_l·ã_{l-1} + W_l·ȧ_{l-1},   ȧ_l = σ'(z_l) * ż_l,   (J·v)_k = w_k·ẏ_k
    Jᵀ·u:  δ_L = w * u,   δ_{l-1} = (W_lᵀ·δ_l) * σ'(z_{l-1}),   ∂/∂V_l = δ_l·ã_{l-1}ᵀ
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.training.mlp import Mlp
from casadi_contact.networks.training.rows import Block, Factors
from casadi_contact.networks.training.weights import split


class SeveralOutputsMlp(Mlp):
    """Residuals of one network of m outputs, targets and weights (rows, m); otherwise as `Mlp`."""

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return self.outputs

    def _output(self, a: Array, layer: Array) -> Array:
        return (layer @ a).T

    def _output_step(self, weight: Array, residuals: Array) -> Array | None:
        steps = [self._least_squares(weight[:, k], residuals[:, k]) for k in range(self.outputs)]
        found = [step for step in steps if step is not None]
        return np.stack(found) if len(found) == self.outputs else None

    def _derivatives(self, block: Block, layers: list[Array]) -> list[Array]:
        """σ' of hidden layers, and w (outputs, rows)."""
        slopes = [block.activation_slope(level) for level in range(len(layers) - 1)]
        return [*slopes, self._weight[block.rows].T]

    def _rough(self, exact: Factors) -> Factors:
        *slopes, weight = exact.derivatives
        derivatives = [*slopes, weight * (1.0 / self._unit)]
        all_arrays = exact.inputs, derivatives, exact.layers
        return Factors(*([array.astype(np.float32) for array in arrays] for arrays in all_arrays))

    def _forward_product(self, of: Factors, layers: list[Array]) -> Array:
        *slopes, weight = of.derivatives
        tangent = layers[0] @ of.inputs[0]
        for level, slope in enumerate(slopes, start=1):
            tangent *= slope
            tangent = layers[level] @ of.inputs[level] + of.layers[level][:, :-1] @ tangent
        return (tangent * weight).T

    def _add_reverse_product(self, total: Array, of: Factors, rows: Array) -> None:
        *slopes, weight = of.derivatives
        layers, delta = split(total, self.shapes), rows.T * weight
        for level in range(len(layers) - 1, -1, -1):
            layers[level] += delta @ of.inputs[level].T
            if level:
                delta = (of.layers[level][:, :-1].T @ delta) * slopes[level - 1]

    def jacobian(self, rows: Any, out: Array | None = None) -> Array:
        """Rows of J, the residuals of each row below each other (len(rows)·m, parameters)."""
        index = np.arange(self.rows)[rows]
        delta = self._weight[index][:, :, None] * np.eye(self.outputs)  # ∂r/∂y (rows, residuals of a row, outputs)
        layers, count = self._blocks[0].exact.layers, len(index) * self.per_row
        out = np.empty((count, self.parameter_count)) if out is None else out[:count]
        end = self.parameter_count
        for level in range(len(self.shapes) - 1, -1, -1):
            neurons, width = self.shapes[level]
            a = self._columns(index, "inputs", level)
            out[:, end - neurons * width : end] = np.einsum("nkj,in->nkji", delta, a).reshape(count, -1)
            end -= neurons * width
            if level:
                slope = self._columns(index, "derivatives", level - 1)
                delta = (delta @ layers[level][:, :-1]) * slope.T[:, None]
        return out
