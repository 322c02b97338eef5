"""The network in training: residuals, products with their Jacobian J, and JᵀJ, over all rows in blocks.

Parameters are one flat vector (see `weights`), so that with ã = (a, 1) a layer is z_l = V_l·ã_{l-1}, a column for each
row of the data. With the residual r(y) of each row (see `rows`) and δ_l = ∂r/∂z_l,

    ∂r/∂V_l = δ_l ⊗ ã_{l-1},   J·v = Σ_l colsum(δ_l * (V̇_l·ã_{l-1})),   Jᵀ·u = (δ_l * u)·ã_{l-1}ᵀ.

JᵀJ·v therefore costs two small matrix products per layer, about a hundredth of JᵀJ itself. On many rows it is computed
in single precision: steps need it to a few digits, and it takes half the time. Losses and gradients are in double.

Of a network of several outputs, with residuals r_k = w_k·(y_k - target_k) for every row and output k, ∂r/∂z_l would be
many. Its products go through the layers forwards and backwards instead, at about the price of one output; with W_l the
matrix V_l without its bias column,

    J·v:   ȧ_0 = 0,   ż_l = V̇_l·ã_{l-1} + W_l·ȧ_{l-1},   ȧ_l = σ'(z_l) * ż_l,   (J·v)_k = w_k·ẏ_k
    Jᵀ·u:  δ_L = w * u,   δ_{l-1} = (W_lᵀ·δ_l) * σ'(z_{l-1}),   ∂/∂V_l = δ_l·ã_{l-1}ᵀ

`Mlp.flop` counts the operations of all matrix products, two for each row and parameter: the same on any machine.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg
from scipy.linalg.blas import dsyrk

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.rows import Block, Factors, RowLoss, draw_rows
from casadi_contact.networks.training.weights import layer_shapes, split

_ROWS_PER_PARAMETER = 1.5  # that JᵀJ of the preconditioner is assembled from
_OUTPUT_RIDGE = 1e-13  # of the least-squares problem of the output layer, relative


def cholesky(gram: Array, shift: float) -> Any | None:
    """Cholesky factor of gram + shift·I, for `scipy.linalg.cho_solve`; None where that is not positive definite."""
    shifted = gram.copy(order="F")
    shifted[np.diag_indices(len(gram))] += shift
    try:
        return scipy.linalg.cho_factor(shifted, lower=False, overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        return None


class Mlp:
    """Residuals of one network of one output on one set of rows, and their Jacobian at the accepted parameters.

    `evaluate` tries parameters; `accept` makes the last tried ones current, to which products and `gram` refer.
    single_from: number of rows from which on JᵀJ·v is computed in single precision.
    """

    def __init__(self, like: Network, data: Regression, chunk_rows: int = 2000, *, single_from: int = 5000) -> None:
        self.like, self.rows, self.outputs = like, len(data.targets), like.outputs
        self.shapes = layer_shapes(data.inputs.shape[1], like.hidden, self.outputs)
        self.parameter_count = like.parameter_count
        false = np.broadcast_to(data.false_load * np.square(like.output_scale), data.targets.shape)
        targets, row_weights = data.targets / like.output_scale, data.weights * like.output_scale
        self._rows = RowLoss(
            np.ascontiguousarray(targets), np.ascontiguousarray(row_weights), false.copy() if false.any() else None
        )
        self._unit = float(np.abs(row_weights).max(initial=0.0)) or 1.0  # of weights in single precision
        scaled = np.vstack([((data.inputs - like.input_shift) / like.input_scale).T, np.ones(self.rows)])
        parts = [slice(k, min(k + chunk_rows, self.rows)) for k in range(0, self.rows, chunk_rows)]
        self._blocks = [Block(activation_of(like.activation), scaled[:, part], like.hidden, part) for part in parts]
        self._chunk_rows = chunk_rows
        self._outputs = self._tried_outputs = np.zeros(targets.shape)
        self._weight, self.residuals = self._rows.weight_and_residual(self._outputs)  # at the current parameters
        self._single = self.rows >= single_from
        self.flop = 0

    @property
    def rows_to_draw(self) -> int:
        """Rows that a preconditioner is assembled from, about."""
        return int(_ROWS_PER_PARAMETER * self.parameter_count / self.outputs)

    def _count(self, products: int) -> None:
        """Count products of one operation pair for each row and parameter."""
        self.flop += 2 * products * self.rows * self.parameter_count

    # --- trying parameters

    def evaluate(self, parameters: Array, *, solve_output: bool = True) -> tuple[Array, float]:
        """Parameters with the linear output layer solved exactly, and ½Σr² there.

        For given hidden layers the best output layer is a small least-squares problem (variable projection, Golub
        and Pereyra 1973); solving it at every step nearly halves the error reached in a given time. The result never
        has a higher loss than ``parameters`` as given; not a number or infinity is returned as an infinite loss.
        """
        layers = split(parameters, self.shapes)
        for block in self._blocks:
            block.run(layers)
        self._count(1)
        outputs = self._tried_outputs = self._outputs_with(layers[-1])
        loss = self._loss(outputs)
        if not np.isfinite(loss):
            return parameters, np.inf
        if not solve_output:
            return parameters, loss
        step = self._output_step(*self._rows.weight_and_residual(outputs))
        if step is None:
            return parameters, loss
        projected = np.array(parameters)
        output = split(projected, self.shapes)[-1]
        output -= step
        outputs = self._outputs_with(output)
        solved = self._loss(outputs)
        if not solved < loss:
            return parameters, loss
        self._tried_outputs = outputs
        return projected, solved

    def _outputs_with(self, output: Array) -> Array:
        """y of all rows with the tried activations and this output layer."""
        outputs = np.empty(self._outputs.shape)
        for block in self._blocks:
            outputs[block.rows] = self._output(block.tried[-1], output)
        return outputs

    def _loss(self, outputs: Array) -> float:
        return 0.5 * float(self._rows.squares(outputs).sum())

    def _output(self, a: Array, layer: Array) -> Array:
        """y from the inputs ã (width, rows) of the output layer, (rows,) or (rows, outputs)."""
        return layer[0] @ a

    def _output_step(self, weight: Array, residuals: Array) -> Array | None:
        """Newton step of the output layer (outputs, width) at the tried activations; None where undetermined."""
        columns = (array.reshape(self.rows, self.outputs).T for array in (weight, residuals))
        steps = [self._least_squares(*of_output) for of_output in zip(*columns, strict=True)]
        found = [step for step in steps if step is not None]
        return np.stack(found) if len(found) == self.outputs else None

    def _least_squares(self, weight: Array, residuals: Array) -> Array | None:
        """v that minimises Σ(w·v·ã - r)² over rows with the tried activations ã of the last hidden layer."""
        width = self.shapes[-1][1]
        gram, right = np.zeros((width, width)), np.zeros(width)
        for block in self._blocks:
            weighted = block.tried[-1] * weight[block.rows]
            gram += weighted @ weighted.T
            right += weighted @ residuals[block.rows]
        self.flop += 2 * self.rows * width**2
        factor = cholesky(gram, _OUTPUT_RIDGE * float(np.diagonal(gram).sum()))
        return None if factor is None else scipy.linalg.cho_solve(factor, right, check_finite=False)

    def accept(self, parameters: Array) -> Array:
        """Make the parameters that `evaluate` returned last current; returns the gradient Jᵀr."""
        self._outputs, self._tried_outputs = self._tried_outputs, self._outputs
        self._weight, self.residuals = self._rows.weight_and_residual(self._outputs)
        layers = split(parameters, self.shapes)
        for block in self._blocks:
            block.current, block.tried = block.tried, block.current
            block.exact = Factors(block.current, self._derivatives(block, layers), layers)
            if self._single:
                block.rough = self._rough(block.exact)
        self._count(1)
        return self.vjp(self.residuals)

    # --- products with J at the current parameters

    def _derivatives(self, block: Block, layers: list[Array]) -> list[Array]:
        """δ_l (neurons, rows) of all layers at the current parameters."""
        deltas = [self._weight[None, block.rows]]
        for level in range(len(layers) - 2, -1, -1):
            deltas.insert(0, (layers[level + 1][:, :-1].T @ deltas[0]) * block.activation_slope(level))
        return deltas

    def _rough(self, exact: Factors) -> Factors:
        """In single precision, residuals in units of the largest weight."""
        deltas = [(delta * (1.0 / self._unit)).astype(np.float32) for delta in exact.derivatives]
        return Factors([a.astype(np.float32) for a in exact.inputs], deltas, ())

    def vjp(self, rows: Array) -> Array:
        """Jᵀ·u (parameters,)."""
        total = np.zeros(self.parameter_count)
        for block in self._blocks:
            self._add_reverse_product(total, block.exact, rows[block.rows])
        self._count(1)
        return total

    def gram_product(self, direction: Array) -> Array:
        """JᵀJ·v (parameters,), each block of rows read once; in single precision on many rows, numbers near 1."""
        unit = 1.0
        if self._single:
            size = float(np.abs(direction).max()) or 1.0
            direction, unit = (direction * (1.0 / size)).astype(np.float32), size * self._unit
        layers, total = split(direction, self.shapes), np.zeros(self.parameter_count)
        for block in self._blocks:
            factors = block.rough if self._single else block.exact
            self._add_reverse_product(total, factors, self._forward_product(factors, layers))
        self._count(2)
        return total * (unit * self._unit if self._single else unit)

    def _forward_product(self, of: Factors, layers: list[Array]) -> Array:
        product: Any = 0.0
        for a, delta, layer in zip(of.inputs, of.derivatives, layers, strict=True):
            product = product + ((layer @ a) * delta).sum(0)
        return np.asarray(product)

    def _add_reverse_product(self, total: Array, of: Factors, rows: Array) -> None:
        for a, delta, layer in zip(of.inputs, of.derivatives, split(total, self.shapes), strict=True):
            layer += (delta * rows) @ a.T

    # --- J and JᵀJ

    def jacobian(self, rows: np.ndarray) -> Array:
        """J (len(rows)·outputs, parameters) of these ascending rows."""
        jacobian, start = np.empty((len(rows), self.parameter_count)), 0
        for level, (neurons, width) in enumerate(self.shapes):
            delta, a = (self._columns(rows, of, level) for of in ("derivatives", "inputs"))
            jacobian[:, start : start + neurons * width] = np.einsum("in,jn->nij", delta, a).reshape(len(rows), -1)
            start += neurons * width
        return jacobian

    def _columns(self, rows: np.ndarray, of: str, level: int) -> Array:
        """The exact factors "inputs" or "derivatives" of a layer at these ascending rows, side by side."""
        parts = []
        for k in np.unique(rows // self._chunk_rows).tolist():
            block = self._blocks[k]
            first, last = np.searchsorted(rows, [block.rows.start, block.rows.stop])
            parts.append(getattr(block.exact, of)[level][:, rows[first:last] - block.rows.start])
        return np.concatenate(parts, 1)

    def gram(self, rows: np.ndarray, scales: Array) -> Array:
        """JᵀJ (upper triangle) of these ascending rows, each multiplied by its scale."""
        at_once = max(500 // self.outputs, 1)
        gram = np.zeros((self.parameter_count, self.parameter_count), order="F")
        for start in range(0, len(rows), at_once):
            c = slice(start, start + at_once)
            part = self.jacobian(rows[c])
            part *= np.repeat(scales[c], self.outputs)[:, None]
            gram = dsyrk(1.0, part.T, beta=1.0, c=gram, overwrite_c=1)  # the transpose is in Fortran order: no copy
        self.flop += len(rows) * self.outputs * self.parameter_count**2  # half of the products: JᵀJ is symmetric
        return gram

    def drawn_gram(self, seed: Sequence[int]) -> Array:
        """JᵀJ as `gram`, estimated from `rows_to_draw` rows, drawn by the norm of their ∂r/∂y."""
        heads = [block.exact.derivatives[-1] for block in self._blocks]
        weights = np.concatenate([np.linalg.norm(head, axis=0) for head in heads])
        return self.gram(*draw_rows(weights, self.rows_to_draw, seed))


class SeveralOutputsMlp(Mlp):
    """Residuals of one network of m outputs, targets and weights (rows, m); otherwise as `Mlp`."""

    def _output(self, a: Array, layer: Array) -> Array:
        return (layer @ a).T

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

    def jacobian(self, rows: np.ndarray) -> Array:
        """The residuals of each row below each other."""
        delta = self._weight[rows][:, :, None] * np.eye(self.outputs)  # ∂r/∂y (rows, residuals of a row, outputs)
        layers: list[Array] = []
        for level in range(len(self.shapes) - 1, -1, -1):
            a = self._columns(rows, "inputs", level)
            layers.insert(0, np.einsum("nkj,in->nkji", delta, a).reshape(len(rows) * self.outputs, -1))
            if level:
                slope = self._columns(rows, "derivatives", level - 1)
                delta = (delta @ self._blocks[0].exact.layers[level][:, :-1]) * slope.T[:, None]
        return np.hstack(layers)
