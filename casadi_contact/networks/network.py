"""The plain-array feed-forward network: what training produces and every surrogate evaluates.

Fully connected, sigmoidal hidden neurons, linear output neurons, of which there is one in [EF15 §2.6]:

    a_0 = (x - input_shift) / input_scale,   a_l = σ(W_l a_{l-1} + b_l),   y = output_scale·(W_L a_{L-1} + b_L)

with σ the network's activation (see `casadi_contact.networks.activations`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import h5py
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.activations import activation_of


@dataclass(frozen=True)
class Network:
    """A network with k inputs and m outputs: weights[l] (n_l, n_{l-1}), biases[l] (n_l,), output_scale () or (m,)."""

    input_shift: Array
    input_scale: Array
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    output_scale: float | Array = 1.0
    activation: str = "algebraic"
    hidden: tuple[int, ...] = field(init=False)
    """Neurons per hidden layer, for example (32, 32)."""
    outputs: int = field(init=False)
    """Number m of outputs."""

    def __post_init__(self) -> None:
        activation_of(self.activation)
        width = len(self.input_shift)
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (len(bias), width):
                raise ValueError(f"layer {layer} has weights {weight.shape}, expected {(len(bias), width)}")
            width = len(bias)
        if len(self.input_scale) != len(self.input_shift) or np.shape(self.output_scale) not in ((), (width,)):
            scales = f"{len(self.input_scale)} input scales, output scales of shape {np.shape(self.output_scale)}"
            raise ValueError(f"network of {len(self.input_shift)} inputs and {width} outputs has {scales}")
        arrays = (self.input_shift, self.input_scale, *self.weights, *self.biases, np.array(self.output_scale))
        if not all(np.isfinite(array).all() for array in arrays):
            raise ValueError("network holds NaN or infinity in its weights or scales, expected finite numbers")
        if not self.weights or not np.all(self.input_scale):
            raise ValueError(f"{len(self.weights)} layers, scales {self.input_scale}, expected a layer, no scale of 0")
        object.__setattr__(self, "hidden", tuple(len(bias) for bias in self.biases[:-1]))
        object.__setattr__(self, "outputs", len(self.biases[-1]))

    @property
    def parameter_count(self) -> int:
        """Number of trained weights and biases."""
        return sum(w.size + b.size for w, b in zip(self.weights, self.biases, strict=True))

    def value(self, inputs: Array) -> Array:
        """y of shape (n,) for inputs of shape (n, k); (n, m) for several outputs."""
        a, sigma = (inputs - self.input_shift) / self.input_scale, activation_of(self.activation).derivatives
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            (a,) = sigma(np, a @ weight.T + bias, 0)
        return self._output(a)

    def value_and_gradient(self, inputs: Array) -> tuple[Array, Array]:
        """y (n,) and dy/dx (n, k), by one forward and one reverse pass; (n, m) and (n, m, k) for several outputs."""
        a, sigma = (inputs - self.input_shift) / self.input_scale, activation_of(self.activation).derivatives
        slopes = []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            a, slope = sigma(np, a @ weight.T + bias, 1)
            slopes.append(slope)
        last = self.weights[-1] * np.reshape(self.output_scale, (-1, 1))
        if self.outputs == 1:
            reverse = np.broadcast_to(last[0], a.shape)
        else:
            reverse = np.broadcast_to(last, (len(a), *last.shape))
            slopes = [slope[:, None] for slope in slopes]
        for weight, slope in zip(self.weights[-2::-1], slopes[::-1], strict=True):
            reverse = (reverse * slope) @ weight
        return self._output(a), reverse / self.input_scale

    def _output(self, a: Array) -> Array:
        """y from the activations (n, n_{L-1}) of the last hidden layer."""
        weight, bias = self.weights[-1], self.biases[-1]
        if self.outputs == 1:
            return np.asarray(self.output_scale * (a @ weight[0] + bias[0]))
        return np.asarray(self.output_scale * (a @ weight.T + bias))


@dataclass(frozen=True)
class Regression:
    """One network to fit, the root mean square of its residuals wanted below tolerance:

        residual_i² = (weights_i·(net(inputs_i) - targets_i))² + (false_load_i·max(net(inputs_i), 0)²)²

    inputs (n, k); targets, weights (n,), or (n, m) for a network of m > 1 outputs, whose squares add up in a row.
    false_load (n,): for root loads, the reference load where there is no load, so that a load predicted there counts as
    what it is, and not as a distance to the target; 0 elsewhere, or 0 for all rows.
    validation (n,) is True for the rows that may stop training but never steer it ([EF15 §2.6], criterion 3).
    Weights turn residuals into the unit of the tolerance (N, N·mm or shares of what is wanted).
    domain (n,): of rows that are samples, 1 to 7 for D1 to D7.
    """

    name: str
    inputs: Array
    targets: Array
    weights: Array
    validation: np.ndarray
    tolerance: float
    false_load: Array | float = 0.0
    domain: np.ndarray | None = None

    @property
    def outputs(self) -> int:
        """Number of the network's outputs."""
        return 1 if np.ndim(self.targets) == 1 else np.shape(self.targets)[1]

    def of_rows(self, rows: np.ndarray) -> Regression:
        """The regression on these of its rows."""
        columns = {name: getattr(self, name)[rows] for name in ("inputs", "targets", "weights", "validation")}
        false_load = np.broadcast_to(self.false_load, np.shape(self.targets))[rows]
        domain = None if self.domain is None else self.domain[rows]
        return replace(self, **columns, false_load=false_load, domain=domain)

    def weighted(self, by_domain: Mapping[int, float]) -> Regression:
        """With the residuals of these domains multiplied, all scaled to a mean square factor of 1."""
        if not by_domain:
            return self
        if self.domain is None:
            raise ValueError("the regression's rows belong to no domain, expected samples")
        factors = np.ones(len(self.domain))
        for number, factor in by_domain.items():
            factors[self.domain == number] = factor
        factors /= np.sqrt(np.mean(factors**2))
        false_load = factors * self.false_load if np.any(self.false_load) else 0.0
        columns = factors.reshape(-1, *[1] * (np.ndim(self.targets) - 1))
        return replace(self, weights=columns * self.weights, false_load=false_load)

    def squares(self, network: Network) -> Array:
        """residual² of each row (n,)."""
        values = network.value(self.inputs)
        off, false = self.weights * (values - self.targets), self.false_load * np.maximum(values, 0.0) ** 2
        return np.asarray(off**2 + false**2).reshape(-1, self.outputs).sum(axis=1)


def size_text(hidden: Sequence[int]) -> str:
    """Neurons per hidden layer as people write them: "12-12"."""
    return "-".join(map(str, hidden))


def write_network(group: h5py.Group, network: Network) -> None:
    """Fill a group with a network's numbers."""
    group.attrs["activation"] = network.activation
    group.attrs["output_scale"] = network.output_scale
    group["input_shift"] = np.asarray(network.input_shift, dtype="<f8")
    group["input_scale"] = np.asarray(network.input_scale, dtype="<f8")
    for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        group[f"weight_{layer}"] = np.asarray(weight, dtype="<f8")
        group[f"bias_{layer}"] = np.asarray(bias, dtype="<f8")


def read_network(group: h5py.Group) -> Network:
    """The network of a group that `write_network` filled; raises ValueError for numbers that are none."""
    layers, scale = sum(key.startswith("weight_") for key in group), group.attrs["output_scale"]
    return Network(
        input_shift=group["input_shift"][()],
        input_scale=group["input_scale"][()],
        weights=tuple(group[f"weight_{layer}"][()] for layer in range(layers)),
        biases=tuple(group[f"bias_{layer}"][()] for layer in range(layers)),
        output_scale=float(scale) if np.ndim(scale) == 0 else np.asarray(scale, dtype=float),
        activation=str(group.attrs["activation"]),
    )
