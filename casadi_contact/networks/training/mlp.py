"""The network in training: residuals, products with its Jacobian, and JᵀJ, over all rows in chunks.

Parameters are one flat vector (see `weights`), so that with ã = (a, 1) a layer is z_l = V_l·ã_{l-1}, a column for each
row of the data. With the residual r(y) of each row (see `row_loss`) and δ_l = ∂r/∂z_l,

    ∂r/∂V_l = δ_l ⊗ ã_{l-1},   J·v = Σ_l colsum(δ_l * (V̇_l·ã_{l-1})),   Jᵀ·u = (δ_l * u)·ã_{l-1}ᵀ.

So JᵀJ·v costs two small matrix products per layer, about a hundredth of JᵀJ itself. On many rows it is made in single
precision: steps need it to a few digits, and it takes half the time. Losses and gradients are in double precision.

`Mlp.flop` counts the floating-point operations of all matrix products, two for each row and parameter that one of
them visits: what a fit has cost, the same on any machine, however busy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.networks.training.arrays import NumpyArrays
from casadi_contact.networks.training.chunk import Chunk, Factors
from casadi_contact.networks.training.drawn_rows import draw_rows
from casadi_contact.networks.training.row_loss import RowLoss
from casadi_contact.networks.training.weights import layer_shapes, split

ROWS_PER_PARAMETER = 1.5  # that a preconditioner is assembled from
# Relative ridge of the small least-squares problem of the output layer: below what double precision resolves well.
OUTPUT_RIDGE = 1e-13
SINGLE_FROM = 5000  # rows, from which on JᵀJ·v is made in single precision


class Mlp:
    """Residuals of one network on one set of rows, and their Jacobian at the accepted parameters.

    `evaluate` tries parameters; `accept` makes the last tried ones current, which `jvp`, `vjp`, `gram_product`,
    `gram` refer to.
    """

    def __init__(
        self,
        like: Network,
        inputs: Array,
        targets: Array,
        weights: Array,
        false_load: Array | float,
        arrays: NumpyArrays,
        chunk_rows: int = 2000,
    ) -> None:
        self.arrays, self.xp = arrays, arrays.xp
        self.like, self.rows = like, len(targets)
        self.outputs = like.outputs
        self.shapes = layer_shapes(inputs.shape[1], like.hidden, self.outputs)
        self.parameter_count = sum(neurons * width for neurons, width in self.shapes)
        false = np.broadcast_to(false_load * np.square(like.output_scale), targets.shape)
        row_weights = weights * like.output_scale
        self._rows = RowLoss(
            arrays.array(targets / like.output_scale),
            arrays.array(row_weights),
            arrays.array(false.copy()) if false.any() else None,
        )
        self._unit = float(np.abs(row_weights).max(initial=0.0)) or 1.0  # of weights in single precision
        self._chunks = list(self._chunks_of(inputs, chunk_rows))
        self._chunk_rows = chunk_rows
        self._outputs = self._tried_outputs = arrays.zeros(*targets.shape)
        self._weight, self.residuals = self._rows.weight_and_residual(self._outputs)  # at the current parameters
        self._jacobian_rows: Any = None
        self._single = self.rows >= SINGLE_FROM
        self.flop = 0

    def _chunks_of(self, inputs: Array, chunk_rows: int) -> Iterator[Chunk]:
        scaled = np.vstack([((inputs - self.like.input_shift) / self.like.input_scale).T, np.ones(self.rows)])
        activation = activation_of(self.like.activation)
        for start in range(0, self.rows, chunk_rows):
            c = slice(start, min(start + chunk_rows, self.rows))
            yield Chunk(self.arrays, activation, scaled[:, c], self.like.hidden, c)

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return 1

    @property
    def block_parameters(self) -> int:
        """Parameters of a block of JᵀJ: all, which stand in one."""
        return self.parameter_count

    @property
    def rows_to_draw(self) -> int:
        """Rows that a preconditioner is assembled from, about."""
        return int(ROWS_PER_PARAMETER * self.parameter_count / self.per_row)

    def drawn_gram(self, seed: Sequence[int]) -> Any:
        """JᵀJ as `gram`, of `rows_to_draw` rows that stand for all, drawn by the norm of their ∂r/∂y."""
        heads = [self.arrays.numpy(chunk.exact.derivatives[-1]) for chunk in self._chunks]
        weights = np.concatenate([np.linalg.norm(head, axis=0) for head in heads])
        return self.gram(*draw_rows(weights, self.rows_to_draw, seed))

    def _count(self, products: int) -> None:
        """Count products of one operation pair for each row and parameter."""
        self.flop += 2 * products * self.rows * self.parameter_count

    def evaluate(self, parameters: Any, *, solve_output: bool = True) -> tuple[Any, float]:
        """Parameters with the linear output layer solved exactly, and ½Σr² there.

        For any hidden layers the best output layer is a small least-squares problem (variable projection, Golub
        and Pereyra 1973); solving it at every trial nearly halves the error reached in a given time. The result never
        has a higher loss than ``parameters`` as given; not a number or infinity is returned as an infinite loss.
        """
        layers = split(parameters, self.shapes)
        for chunk in self._chunks:
            chunk.run(layers)
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
        projected = self.arrays.array(self.arrays.numpy(parameters).copy())
        output = split(projected, self.shapes)[-1]
        output -= step
        outputs = self._outputs_with(output)
        solved = self._loss(outputs)
        if not solved < loss:
            return parameters, loss
        self._tried_outputs = outputs
        return projected, solved

    def _outputs_with(self, output: Any) -> Any:
        """y of all rows with the tried activations and this output layer."""
        outputs = self.arrays.empty(*self._outputs.shape)
        for chunk in self._chunks:
            outputs[chunk.rows] = self._output(chunk.tried[-1], output)
        return outputs

    def _loss(self, outputs: Any) -> float:
        return 0.5 * float(self._rows.squares(outputs).sum())

    def _output(self, a: Any, layer: Any) -> Any:
        """y from the inputs ã (width, rows) of the output layer, (rows,) or (rows, outputs)."""
        return layer[0] @ a

    def _output_step(self, weight: Any, residuals: Any) -> Any | None:
        """What the output layer (outputs, width) has too much, with the tried activations; None where undetermined."""
        return self._least_squares(weight, residuals)

    def _least_squares(self, weight: Any, residuals: Any) -> Any | None:
        """v that minimises Σ(w·v·ã - r)² over rows with the tried activations ã of the last hidden layer."""
        width = self.shapes[-1][1]
        gram, right = self.arrays.zeros(width, width), self.arrays.zeros(width)
        for chunk in self._chunks:
            weighted = chunk.tried[-1] * weight[chunk.rows]
            gram += weighted @ weighted.T
            right += weighted @ residuals[chunk.rows]
        self.flop += 2 * self.rows * width**2
        factor = self.arrays.factor(gram, OUTPUT_RIDGE * float(self.arrays.diagonal(gram).sum()))
        return None if factor is None else self.arrays.solve(factor, right)

    def accept(self, parameters: Any) -> Any:
        """Make the parameters that `evaluate` returned last current; returns the gradient Jᵀr."""
        self.move(parameters)
        return self.vjp(self.residuals)

    def move(self, parameters: Any) -> None:
        """`accept` without the gradient."""
        self._outputs, self._tried_outputs = self._tried_outputs, self._outputs
        self._weight, self.residuals = self._rows.weight_and_residual(self._outputs)
        layers = split(parameters, self.shapes)
        for chunk in self._chunks:
            chunk.swap()
            chunk.exact = Factors(chunk.current, self._derivatives(chunk, layers), layers)
            if self._single:
                chunk.rough = self._rough(chunk.exact)
        self._count(1)

    def _derivatives(self, chunk: Chunk, layers: list[Any]) -> list[Any]:
        """δ_l (neurons, rows) of all layers at the current parameters."""
        deltas = [self._weight[None, chunk.rows]]
        for level in range(len(layers) - 2, -1, -1):
            deltas.insert(0, (layers[level + 1][:, :-1].T @ deltas[0]) * chunk.slope(level))
        return deltas

    def _rough(self, exact: Factors) -> Factors:
        """In single precision, residuals in units of the largest weight."""
        single = self.arrays.single
        deltas = [single(delta * (1.0 / self._unit)) for delta in exact.derivatives]
        return Factors([single(a) for a in exact.inputs], deltas, ())

    @property
    def tried_outputs(self) -> Any:
        """y (rows,) in units of the output scale, at the parameters that `evaluate` saw last."""
        return self._tried_outputs

    def jvp(self, direction: Any, *, rough: bool = False) -> Any:
        """J·v (rows,); rough: in single precision, on many rows."""
        layers, unit = self._directions(direction, rough)
        product = self.arrays.zeros(*self._outputs.shape)
        for chunk in self._chunks:
            product[chunk.rows] = self._forward_product(self._factors(chunk, rough), layers)
        self._count(1)
        return product * unit

    def vjp(self, rows: Any, *, rough: bool = False) -> Any:
        """Jᵀ·u (parameters,); rough: in single precision, on many rows."""
        total, unit = self.arrays.zeros(self.parameter_count), 1.0
        if rough and self._single:
            size = float(self.xp.abs(rows).max()) or 1.0
            rows, unit = self.arrays.single(rows * (1.0 / size)), size * self._unit
        for chunk in self._chunks:
            self._add_reverse_product(total, self._factors(chunk, rough), rows[chunk.rows])
        self._count(1)
        return total * unit

    def gram_product(self, direction: Any) -> Any:
        """JᵀJ·v (parameters,), each chunk of rows read once; in single precision, on many rows."""
        layers, unit = self._directions(direction, rough=True)
        total = self.arrays.zeros(self.parameter_count)
        for chunk in self._chunks:
            factors = self._factors(chunk, rough=True)
            self._add_reverse_product(total, factors, self._forward_product(factors, layers))
        self._count(2)
        return total * (unit * self._unit if self._single else unit)

    def _factors(self, chunk: Chunk, rough: bool) -> Factors:
        return chunk.rough if rough and self._single else chunk.exact

    def _directions(self, direction: Any, rough: bool) -> tuple[list[Any], float]:
        """The layers of a direction, and what a product with these is to be multiplied by: numbers in single precision
        are near 1."""
        if not (rough and self._single):
            return split(direction, self.shapes), 1.0
        size = float(self.xp.abs(direction).max()) or 1.0
        return split(self.arrays.single(direction * (1.0 / size)), self.shapes), size * self._unit

    def _forward_product(self, of: Factors, layers: list[Any]) -> Any:
        product = 0.0
        for a, delta, layer in zip(of.inputs, of.derivatives, layers, strict=True):
            product = product + ((layer @ a) * delta).sum(0)
        return product

    def _add_reverse_product(self, total: Any, of: Factors, rows: Any) -> None:
        for a, delta, layer in zip(of.inputs, of.derivatives, split(total, self.shapes), strict=True):
            layer += (delta * rows) @ a.T

    def jacobian(self, rows: Any, out: Any | None = None) -> Any:
        """Rows of J (len(rows), parameters), ``rows`` a slice or ascending indices; written to ``out`` if given."""
        index = np.arange(self.rows)[rows]
        out = self.arrays.empty(len(index), self.parameter_count) if out is None else out[: len(index)]
        start = 0
        for level, (neurons, width) in enumerate(self.shapes):
            delta = self._columns(index, lambda chunk, level=level: chunk.exact.derivatives[level])
            a = self._columns(index, lambda chunk, level=level: chunk.exact.inputs[level])
            block = self.xp.einsum("in,jn->nij", delta, a)
            out[:, start : start + neurons * width] = block.reshape(len(index), -1)
            start += neurons * width
        return out

    def _columns(self, rows: np.ndarray, of: Any) -> Any:
        """Of(chunk) of these ascending rows, side by side."""
        parts = []
        for k in np.unique(rows // self._chunk_rows).tolist():
            chunk = self._chunks[k]
            first, last = np.searchsorted(rows, [chunk.rows.start, chunk.rows.stop])
            parts.append(of(chunk)[:, rows[first:last] - chunk.rows.start])
        return self.xp.concatenate(parts, 1)

    def gram(self, rows: np.ndarray | None = None, row_scales: Array | None = None) -> Any:
        """JᵀJ (upper triangle at least), of all rows or of chosen ascending ones, each multiplied by its scale."""
        count = self.rows if rows is None else len(rows)
        at_once = min(500 // self.per_row, self.rows)
        if self._jacobian_rows is None:
            self._jacobian_rows = self.arrays.empty(at_once * self.per_row, self.parameter_count)
        gram = self.arrays.new_gram(self.parameter_count)
        for start in range(0, count, at_once):
            c = slice(start, min(start + at_once, count))
            part = self.jacobian(c if rows is None else rows[c], out=self._jacobian_rows)
            if row_scales is not None:
                part *= self.arrays.array(np.repeat(row_scales[c], self.per_row))[:, None]
            gram = self.arrays.add_gram(gram, part)
        self.flop += count * self.per_row * self.parameter_count**2  # half of the products: JᵀJ is symmetric
        return gram

    def weighted_residuals(self, parameters: Any) -> Array:
        """Of these rows at any parameters, without touching the current ones: what `network.Regression` calls them."""
        layers, parts = split(parameters, self.shapes), []
        for chunk in self._chunks:
            y, rows = self._output(chunk.run_apart(layers), layers[-1]), self._rows.of(chunk.rows)
            off, excess = self.arrays.numpy(rows.residual(y)), self.arrays.numpy(rows.excess(y))
            parts.append(np.copysign(np.hypot(off, excess), off))
        self._count(1)
        return np.concatenate(parts) if parts else np.empty(0)
