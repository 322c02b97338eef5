"""A network of several outputs in training: the products of `mlp`, at about the price of one output.

With residuals r_k = w_k·(y_k - target_k) for every row and output k, and W_l the matrix V_l without its bias column,
the products go through the layers forwards and backwards instead of through ∂r/∂z_l, of which there are now several:

    J·v:   ȧ_0 = 0,   ż_l = ã_{l-1}·V̇_lᵀ + ȧ_{l-1}·W_lᵀ,   ȧ_l = σ'(z_l) * ż_l,   (J·v)_k = w_k·ẏ_k
    Jᵀ·u:  δ_L = w * u,   δ_{l-1} = (δ_l·W_l) * σ'(z_{l-1}),   ∂/∂V_l = δ_lᵀ·ã_{l-1}
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.training.mlp import Mlp, split


class TrunkMlp(Mlp):
    """Residuals of one network of m outputs, targets and weights (rows, m); otherwise as `Mlp`."""

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return self.outputs

    def _prepare(self) -> None:
        self._slopes = [self.arrays.empty(self.rows, neurons) for neurons, _ in self.shapes[:-1]]
        self._layers: list[Any] = []

    @property
    def draw_weights(self) -> Array:
        """Norm (rows,) of each row's weights: what rows are drawn by."""
        return np.asarray(np.linalg.norm(self.row_weights, axis=1))

    def _output(self, a: Any, layer: Any) -> Any:
        return a @ layer.T

    def _output_step(self, residuals: Any) -> Any | None:
        steps = [self._least_squares(self._weight[:, k], residuals[:, k]) for k in range(self.outputs)]
        return None if any(step is None for step in steps) else self.xp.stack(steps)

    def accept(self, parameters: Any) -> Any:
        """Make the parameters that `evaluate` returned last current; returns the gradient Jᵀr."""
        self._swap()
        self._layers = split(parameters, self.shapes)
        for slopes, values in zip(self._slopes, self._current[1:], strict=True):
            for c in self._chunks():
                slopes[c] = self._activation.slope_from_value(self.xp, values[c][:, :-1])
        self._accept_output()
        return self.vjp(self._residuals)

    def _accept_output(self) -> None:
        """Keep what the three below need of the outputs at the current parameters."""

    def _of_outputs(self, tangent: Any, c: slice) -> Any:
        """Change of the residuals of rows c with that of their outputs (len(c), outputs)."""
        return tangent * self._weight[c]

    def _by_outputs(self, rows: Any, c: slice) -> Any:
        """Jᵀ·u at the outputs (len(c), outputs)."""
        return rows * self._weight[c]

    def _seeds(self, rows: Any) -> Any:
        """∂r/∂y (len(rows), residuals of a row, outputs)."""
        weight = self._weight[rows]
        seeds = self.arrays.zeros(len(weight), self.outputs, self.outputs)
        for k in range(self.outputs):
            seeds[:, k, k] = weight[:, k]
        return seeds

    def _forward_product(self, layers: list[Any], c: slice) -> Any:
        tangent = self._current[0][c] @ layers[0].T
        for level, layer in enumerate(layers[1:], start=1):
            tangent *= self._slopes[level - 1][c]
            tangent = self._current[level][c] @ layer.T + tangent @ self._layers[level][:, :-1].T
        return self._of_outputs(tangent, c)

    def _add_reverse_product(self, total: Any, rows: Any, c: slice) -> None:
        layers, delta = split(total, self.shapes), self._by_outputs(rows, c)
        for level in range(len(layers) - 1, -1, -1):
            layers[level] += delta.T @ self._current[level][c]
            if level:
                delta = (delta @ self._layers[level][:, :-1]) * self._slopes[level - 1][c]

    def jacobian(self, rows: Any, out: Any | None = None) -> Any:
        """Rows of J, the residuals of each below each other (len(rows)·m, parameters)."""
        delta = self._seeds(rows)
        count = len(delta) * self.per_row
        out = self.arrays.empty(count, self.parameter_count) if out is None else out[:count]
        end = self.parameter_count
        for level in range(len(self.shapes) - 1, -1, -1):
            neurons, width = self.shapes[level]
            block = self.xp.einsum("nkj,ni->nkji", delta, self._current[level][rows])
            out[:, end - neurons * width : end] = block.reshape(count, -1)
            end -= neurons * width
            if level:
                delta = (delta @ self._layers[level][:, :-1]) * self._slopes[level - 1][rows][:, None]
        return out
