"""The network in training: residuals, exact products with its Jacobian, and JᵀJ, over all rows in chunks.

Parameters are one flat vector: layer after layer its matrix (n_l, n_{l-1} + 1), the bias being the last column, so
that with ã = (a, 1) a layer is z_l = ã_{l-1}·V_lᵀ. With residual r = w·(y - target) and δ_l = ∂r/∂z_l per row,

    ∂r/∂V_l = δ_l ⊗ ã_{l-1},   J·v = Σ_l rowsum(δ_l * (ã_{l-1}·V_lᵀ)),   Jᵀ·u = (δ_l * u)ᵀ·ã_{l-1}.

So JᵀJ·v costs two small matrix products per layer, about a hundredth of JᵀJ itself.

`Mlp.flop` counts the floating-point operations of all matrix products, two for each row and parameter that one of
them visits: what a fit has cost, the same on any machine, however busy.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from casadi_contact.activations import activation_of
from casadi_contact.conventions import Array
from casadi_contact.network import Network
from casadi_contact.training.arrays import NumpyArrays, TorchArrays

ROWS_PER_PARAMETER = 3.0  # that a preconditioner is assembled from
# Relative ridge of the small least-squares problem of the output layer: below what double precision resolves well.
OUTPUT_RIDGE = 1e-13


def layer_shapes(inputs: int, hidden: tuple[int, ...], outputs: int = 1) -> tuple[tuple[int, int], ...]:
    """(neurons, inputs + 1) of each layer, the bias counted as an input."""
    sizes = (inputs, *hidden, outputs)
    return tuple((after, before + 1) for before, after in pairwise(sizes))


def initial_network(
    inputs: Array, targets: Array, hidden: tuple[int, ...], activation: str, seed: Any, spots: int = 1
) -> Network:
    """Random weights N(0, 1/fan_in), biases U(-1, 1), on inputs standardised by the data; outputs in units of the
    targets' standard deviation, starting near their mean. A constant input or target has scale 1 (or its size).
    targets (n,), or (n, m) for several outputs. spots: so many outputs of one scale, which differ from the start."""
    rng = np.random.default_rng(seed)
    shift, scale = inputs.mean(axis=0), inputs.std(axis=0)
    scale = np.where(scale > 1e-12 * np.maximum(np.abs(shift), 1e-300), scale, 1.0)
    spread, mean = np.atleast_1d(targets.std(axis=0)), np.atleast_1d(targets.mean(axis=0))
    size = np.where(mean == 0.0, 1.0, np.abs(mean))
    output_scale = np.where((spread > 1e-12 * np.abs(mean)) & (spread > 0.0), spread, size)
    weights, biases = [], []
    for neurons, fan_in in ((n, k - 1) for n, k in layer_shapes(inputs.shape[1], hidden, spots * len(spread))):
        weights.append(rng.normal(size=(neurons, fan_in)) / np.sqrt(fan_in))
        biases.append(rng.uniform(-1.0, 1.0, neurons))
    if spots > 1:
        biases[-1][:] = 0.0
    else:
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


def split(parameters: Any, shapes: tuple[tuple[int, int], ...]) -> list[Any]:
    """The layers in a vector of parameters, as views of it."""
    layers, start = [], 0
    for neurons, width in shapes:
        layers.append(parameters[start : start + neurons * width].reshape(neurons, width))
        start += neurons * width
    return layers


def _half_square(residuals: Any) -> float:
    flat = residuals.reshape(-1)
    return 0.5 * float(flat @ flat)


class Mlp:
    """Residuals of one network on one set of rows, and their Jacobian at the accepted parameters.

    `evaluate` tries parameters; `accept` makes the last tried ones current, which `jvp`, `vjp`, `gram_product`,
    `gram` refer to. Activations of current and tried parameters lie in two sets of buffers that are swapped.
    """

    def __init__(
        self,
        like: Network,
        inputs: Array,
        targets: Array,
        weights: Array,
        arrays: NumpyArrays | TorchArrays,
        chunk_rows: int = 1000,
    ) -> None:
        self.arrays, self.xp = arrays, arrays.xp
        self._activation = activation_of(like.activation)
        self.like, self.rows, self.chunk_rows = like, len(targets), chunk_rows
        self.outputs = like.outputs
        self.shapes = layer_shapes(inputs.shape[1], like.hidden, self.outputs)
        self.parameter_count = sum(neurons * width for neurons, width in self.shapes)
        self.row_weights = weights * like.output_scale
        scaled = np.column_stack([(inputs - like.input_shift) / like.input_scale, np.ones(self.rows)])
        self._first = arrays.array(scaled)
        self._weight = arrays.array(self.row_weights)
        self._target = arrays.array(targets / like.output_scale)
        self._current, self._tried = self._buffers(), self._buffers()
        self._residuals, self._tried_residuals = arrays.zeros(*self._target.shape), arrays.zeros(*self._target.shape)
        self._jacobian_rows: Any = None
        self.flop = 0
        self._prepare()

    def _prepare(self) -> None:
        """Buffers for the products."""
        self._delta = [self.arrays.empty(self.rows, neurons) for neurons, _ in self.shapes]
        self._delta[-1][:, 0] = self._weight

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

    @property
    def draw_weights(self) -> Array:
        """Weight (rows,) by which rows are drawn for the preconditioner."""
        return np.abs(self.row_weights)

    def _count(self, products: int) -> None:
        """Count products of one operation pair for each row and parameter."""
        self.flop += 2 * products * self.rows * self.parameter_count

    def _buffers(self) -> list[Any]:
        """ã of every layer's input, the constant column of ones set once."""
        buffers = [self._first]
        for neurons, _ in self.shapes[:-1]:
            buffer = self.arrays.empty(self.rows, neurons + 1)
            buffer[:, -1] = 1.0
            buffers.append(buffer)
        return buffers

    def _chunks(self) -> Iterator[slice]:
        for start in range(0, self.rows, self.chunk_rows):
            yield slice(start, min(start + self.chunk_rows, self.rows))

    def _activate(self, z: Any, out: Any) -> None:
        out[...] = self._activation.derivatives(self.xp, z, 0)[0]

    def evaluate(self, parameters: Any, *, solve_output: bool = True) -> tuple[Any, float]:
        """Parameters with the linear output layer solved exactly, and ½Σr² there.

        For any hidden layers the best output layer is a small least-squares problem (variable projection, Golub
        and Pereyra 1973); solving it at every trial nearly halves the error reached in a given time. The result never
        has a higher loss than ``parameters`` as given; not a number or infinity is returned as an infinite loss.
        """
        layers, tried = split(parameters, self.shapes), self._tried
        for c in self._chunks():
            for level, layer in enumerate(layers[:-1]):
                self._activate(tried[level][c] @ layer.T, tried[level + 1][c][:, :-1])
        self._count(1)
        residuals = self._weight * (self._output(tried[-1], layers[-1]) - self._target)
        loss = _half_square(residuals)
        self._tried_residuals = residuals
        if not np.isfinite(loss):
            return parameters, np.inf
        if not solve_output:
            return parameters, loss
        step = self._output_step(residuals)
        if step is None:
            return parameters, loss
        projected = self.arrays.array(self.arrays.numpy(parameters).copy())
        output = split(projected, self.shapes)[-1]
        output -= step
        residuals = self._weight * (self._output(tried[-1], output) - self._target)
        solved = _half_square(residuals)
        if not solved < loss:
            return parameters, loss
        self._tried_residuals = residuals
        return projected, solved

    def _output(self, a: Any, layer: Any) -> Any:
        """y from the inputs ã of the output layer, (rows,) or (rows, outputs)."""
        return a @ layer[0]

    def _output_step(self, residuals: Any) -> Any | None:
        """What the output layer (outputs, width) has too much, with the tried activations; None where undetermined."""
        return self._least_squares(self._weight, residuals)

    def _least_squares(self, weight: Any, residuals: Any) -> Any | None:
        """v that minimises Σ(w·ã·v - r)² over rows with the tried activations ã of the last hidden layer."""
        width = self.shapes[-1][1]
        gram, right = self.arrays.zeros(width, width), self.arrays.zeros(width)
        for c in self._chunks():
            weighted = self._tried[-1][c] * weight[c][:, None]
            gram += weighted.T @ weighted
            right += weighted.T @ residuals[c]
        self.flop += 2 * self.rows * width**2
        factor = self.arrays.factor(gram, OUTPUT_RIDGE * float(self.arrays.diagonal(gram).sum()))
        return None if factor is None else self.arrays.solve(factor, right)

    def accept(self, parameters: Any) -> Any:
        """Make the parameters that `evaluate` returned last current; returns the gradient Jᵀr."""
        self._swap()
        layers = split(parameters, self.shapes)
        for c in self._chunks():
            for level in range(len(layers) - 2, -1, -1):
                delta = self._delta[level][c]
                self.xp.matmul(self._delta[level + 1][c], layers[level + 1][:, :-1], out=delta)
                delta *= self._activation.slope_from_value(self.xp, self._current[level + 1][c][:, :-1])
        self._count(1)
        return self.vjp(self._residuals)

    def _swap(self) -> None:
        """Make what was tried last current."""
        self._current, self._tried = self._tried, self._current
        self._residuals, self._tried_residuals = self._tried_residuals, self._residuals

    @property
    def residuals(self) -> Any:
        """r (rows,) at the current parameters."""
        return self._residuals

    @property
    def tried_residuals(self) -> Any:
        """r (rows,) at the parameters that `evaluate` saw last."""
        return self._tried_residuals

    def jvp(self, direction: Any) -> Any:
        """J·v (rows,)."""
        layers, product = split(direction, self.shapes), self.arrays.zeros(*self._target.shape)
        for c in self._chunks():
            product[c] = self._forward_product(layers, c)
        self._count(1)
        return product

    def vjp(self, rows: Any) -> Any:
        """Jᵀ·u (parameters,)."""
        total = self.arrays.zeros(self.parameter_count)
        for c in self._chunks():
            self._add_reverse_product(total, rows[c], c)
        self._count(1)
        return total

    def gram_product(self, direction: Any) -> Any:
        """JᵀJ·v (parameters,), each chunk of rows read once."""
        layers, total = split(direction, self.shapes), self.arrays.zeros(self.parameter_count)
        for c in self._chunks():
            self._add_reverse_product(total, self._forward_product(layers, c), c)
        self._count(2)
        return total

    def _forward_product(self, layers: list[Any], c: slice) -> Any:
        product = 0.0
        for level, layer in enumerate(layers):
            product = product + self.xp.einsum("ij,ij->i", self._current[level][c] @ layer.T, self._delta[level][c])
        return product

    def _add_reverse_product(self, total: Any, rows: Any, c: slice) -> None:
        for level, layer in enumerate(split(total, self.shapes)):
            layer += (self._delta[level][c] * rows[:, None]).T @ self._current[level][c]

    def jacobian(self, rows: Any, out: Any | None = None) -> Any:
        """Rows of J (len(rows), parameters), ``rows`` a slice or indices; written to ``out`` if given."""
        deltas = [delta[rows] for delta in self._delta]
        count = len(deltas[0])
        out = self.arrays.empty(count, self.parameter_count) if out is None else out[:count]
        start = 0
        for (neurons, width), delta, a in zip(self.shapes, deltas, self._current, strict=True):
            block = self.xp.einsum("ij,ik->ijk", delta, a[rows])
            out[:, start : start + neurons * width] = block.reshape(count, -1)
            start += neurons * width
        return out

    def gram(self, rows: np.ndarray | None = None, row_scales: Array | None = None) -> Any:
        """JᵀJ (upper triangle at least), of all rows or of chosen ones, each multiplied by its scale."""
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
        """w·(y - target) of these rows at any parameters, without touching the current ones."""
        layers, parts = split(parameters, self.shapes), []
        for c in self._chunks():
            a = self._first[c]
            for layer in layers[:-1]:
                z = a @ layer.T
                a = self.arrays.empty(len(z), z.shape[1] + 1)
                self._activate(z, a[:, :-1])
                a[:, -1] = 1.0
            parts.append(self.arrays.numpy(self._weight[c] * (self._output(a, layers[-1]) - self._target[c])))
        self._count(1)
        return np.concatenate(parts) if parts else np.empty(0)
