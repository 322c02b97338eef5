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

# Relative ridge of the small least-squares problem of the output layer: below what double precision resolves well.
_OUTPUT_RIDGE = 1e-13


def layer_shapes(inputs: int, hidden: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """(neurons, inputs + 1) of each layer, the bias counted as an input."""
    sizes = (inputs, *hidden, 1)
    return tuple((after, before + 1) for before, after in pairwise(sizes))


def initial_network(inputs: Array, targets: Array, hidden: tuple[int, ...], activation: str, seed: Any) -> Network:
    """Random weights N(0, 1/fan_in), biases U(-1, 1), on inputs standardised by the data; output in units of the
    targets' standard deviation, starting near their mean. A constant input or target has scale 1 (or its size)."""
    rng = np.random.default_rng(seed)
    shift, scale = inputs.mean(axis=0), inputs.std(axis=0)
    scale = np.where(scale > 1e-12 * np.maximum(np.abs(shift), 1e-300), scale, 1.0)
    spread = float(targets.std())
    mean = float(targets.mean())
    output_scale = spread if spread > 1e-12 * abs(mean) and spread > 0.0 else (abs(mean) or 1.0)
    weights, biases = [], []
    for neurons, fan_in in ((n, k - 1) for n, k in layer_shapes(inputs.shape[1], hidden)):
        weights.append(rng.normal(size=(neurons, fan_in)) / np.sqrt(fan_in))
        biases.append(rng.uniform(-1.0, 1.0, neurons))
    weights[-1] *= 0.1
    biases[-1][:] = mean / output_scale
    return Network(shift, scale, tuple(weights), tuple(biases), output_scale, activation)


def flatten(network: Network) -> Array:
    """Weights and biases as one vector, layer after layer, bias as last column."""
    layers = zip(network.weights, network.biases, strict=True)
    return np.concatenate([np.column_stack([w, b]).ravel() for w, b in layers])


def unflatten(parameters: Array, like: Network) -> Network:
    """The network with these parameters, of the sizes and scales of ``like``."""
    shapes = layer_shapes(len(like.input_shift), like.hidden)
    layers = [layer.copy() for layer in _split(np.asarray(parameters), shapes)]
    weights, biases = tuple(v[:, :-1].copy() for v in layers), tuple(v[:, -1].copy() for v in layers)
    return Network(like.input_shift, like.input_scale, weights, biases, like.output_scale, like.activation)


def _split(parameters: Any, shapes: tuple[tuple[int, int], ...]) -> list[Any]:
    layers, start = [], 0
    for neurons, width in shapes:
        layers.append(parameters[start : start + neurons * width].reshape(neurons, width))
        start += neurons * width
    return layers


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
        self.shapes = layer_shapes(inputs.shape[1], like.hidden)
        self.parameter_count = sum(neurons * width for neurons, width in self.shapes)
        self.row_weights = weights * like.output_scale
        scaled = np.column_stack([(inputs - like.input_shift) / like.input_scale, np.ones(self.rows)])
        self._first = arrays.array(scaled)
        self._weight = arrays.array(self.row_weights)
        self._target = arrays.array(targets / like.output_scale)
        self._current, self._tried = self._buffers(), self._buffers()
        self._delta = [arrays.empty(self.rows, neurons) for neurons, _ in self.shapes]
        self._delta[-1][:, 0] = self._weight
        self._residuals = arrays.empty(self.rows)
        self._tried_residuals = arrays.empty(self.rows)
        self._jacobian_rows: Any = None
        self.flop = 0

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
        layers, tried = _split(parameters, self.shapes), self._tried
        width = self.shapes[-1][1]
        gram, right = self.arrays.zeros(width, width), self.arrays.zeros(width)
        for c in self._chunks():
            for level, layer in enumerate(layers[:-1]):
                self._activate(tried[level][c] @ layer.T, tried[level + 1][c][:, :-1])
        self._count(1)
        residuals = self._output_residuals(layers[-1][0])
        loss = 0.5 * float(residuals @ residuals)
        self._tried_residuals = residuals
        if not np.isfinite(loss):
            return parameters, np.inf
        if not solve_output:
            return parameters, loss
        for c in self._chunks():
            weighted = tried[-1][c] * self._weight[c][:, None]
            gram += weighted.T @ weighted
            right += weighted.T @ residuals[c]
        self.flop += 2 * self.rows * width**2
        factor = self.arrays.factor(gram, _OUTPUT_RIDGE * float(self.arrays.diagonal(gram).sum()))
        if factor is None:
            return parameters, loss
        projected = self.arrays.array(self.arrays.numpy(parameters).copy())
        projected[-width:] -= self.arrays.solve(factor, right)
        residuals = self._output_residuals(projected[-width:])
        solved = 0.5 * float(residuals @ residuals)
        if not solved < loss:
            return parameters, loss
        self._tried_residuals = residuals
        return projected, solved

    def _output_residuals(self, output: Any) -> Any:
        """w·(ã·v - target) with the tried activations of the last hidden layer."""
        return self._weight * (self._tried[-1] @ output - self._target)

    def accept(self, parameters: Any) -> Any:
        """Make the parameters that `evaluate` returned last current; returns the gradient Jᵀr."""
        self._current, self._tried = self._tried, self._current
        self._residuals, self._tried_residuals = self._tried_residuals, self._residuals
        layers = _split(parameters, self.shapes)
        for c in self._chunks():
            for level in range(len(layers) - 2, -1, -1):
                delta = self._delta[level][c]
                self.xp.matmul(self._delta[level + 1][c], layers[level + 1][:, :-1], out=delta)
                delta *= self._activation.slope_from_value(self.xp, self._current[level + 1][c][:, :-1])
        self._count(1)
        return self.vjp(self._residuals)

    @property
    def residuals(self) -> Any:
        """r (rows,) at the current parameters."""
        return self._residuals

    def jvp(self, direction: Any) -> Any:
        """J·v (rows,)."""
        layers, product = _split(direction, self.shapes), self.arrays.zeros(self.rows)
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
        layers, total = _split(direction, self.shapes), self.arrays.zeros(self.parameter_count)
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
        for level, layer in enumerate(_split(total, self.shapes)):
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
        if self._jacobian_rows is None:
            self._jacobian_rows = self.arrays.empty(min(500, self.rows), self.parameter_count)
        buffer = self._jacobian_rows
        gram = self.arrays.new_gram(self.parameter_count)
        for start in range(0, count, len(buffer)):
            c = slice(start, min(start + len(buffer), count))
            part = self.jacobian(c if rows is None else rows[c], out=buffer)
            if row_scales is not None:
                part *= self.arrays.array(row_scales[c])[:, None]
            gram = self.arrays.add_gram(gram, part)
        self.flop += count * self.parameter_count**2  # half of the products: JᵀJ is symmetric
        return gram

    def weighted_residuals(self, parameters: Any) -> Array:
        """w·(y - target) of these rows at any parameters, without touching the current ones."""
        layers, parts = _split(parameters, self.shapes), []
        for c in self._chunks():
            a = self._first[c]
            for layer in layers[:-1]:
                z = a @ layer.T
                a = self.arrays.empty(len(z), z.shape[1] + 1)
                self._activate(z, a[:, :-1])
                a[:, -1] = 1.0
            parts.append(self.arrays.numpy(self._weight[c] * (a @ layers[-1][0] - self._target[c])))
        self._count(1)
        return np.concatenate(parts) if parts else np.empty(0)
