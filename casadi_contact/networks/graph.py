"""Networks as CasADi MX expressions: value, gradient (reverse pass) and Hessian, written out layer by layer.

With z_l = W_l a_{l-1} + b_l, a_l = σ(z_l) and r_l = dy/da_l:

    r_{l-1} = W_lᵀ (r_l ∘ σ'(z_l)),   Z_l = dz_l/dx = W_l diag(σ'(z_{l-1})) Z_{l-1},
    d²y/dx² = Σ_l Z_lᵀ diag(r_l ∘ σ''(z_l)) Z_l

Matrix nodes keep the graph small (about 13 instructions for a value, 50 for a Hessian); automatic
differentiation of the gradient needs three times as many. Nothing is ever expanded to scalars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network


@dataclass(frozen=True)
class Output:
    """value (m), jacobian (m x 6), second (m x 36: row k holds the stacked columns of d² value_k / dpose²); derivatives
    above the order asked for are empty."""

    value: ca.MX
    jacobian: ca.MX = field(default_factory=ca.MX)
    second: ca.MX = field(default_factory=ca.MX)


@dataclass(frozen=True)
class Expressions:
    """Signed root load of every patch and the named loads."""

    roots: Output
    loads: Output


def nan_marker(poses: ca.MX) -> ca.MX:
    """0 for every finite pose (a column of 6 x n), NaN for any other; shape (1 x n), derivatives zero."""
    # |sin| <= 1, and the sine of infinity is NaN. CasADi would simplify 0·pose to 0.
    return ca.floor(0.5 + 0.01 * ca.sum1(ca.sin(poses)))


def nan_if_not_finite(pose: ca.MX, expressions: Expressions) -> Expressions:
    """The expressions, NaN in every entry and order where a pose holds NaN or infinity; other values stay as they are.

    ca.fmax, ca.fmin and comparisons drop NaN, so that it would reach some of the outputs only.
    """
    marker = nan_marker(pose)

    def marked(output: Output) -> Output:
        parts = (output.value, output.jacobian, output.second)
        return Output(*(part if part.is_empty() else part + marker for part in parts))

    return Expressions(marked(expressions.roots), marked(expressions.loads))


@dataclass(frozen=True)
class NetworkValue:
    """y (1 x 1), its gradient (1 x m) and Hessian (m x m) along m tangents up to the order asked for, others empty;
    input_gradient (1 x k): with respect to the k inputs."""

    value: ca.MX
    gradient: ca.MX = field(default_factory=ca.MX)
    hessian: ca.MX = field(default_factory=ca.MX)
    input_gradient: ca.MX = field(default_factory=ca.MX)


def _constant(array: np.ndarray) -> ca.MX:
    return ca.MX(ca.DM(array))


def network_values(
    network: Network, x: ca.MX, order: int = 0, tangent: ca.MX | None = None, outputs: Sequence[int] = (0,)
) -> list[NetworkValue]:
    """These outputs of a network for a column x of k inputs, with derivatives up to order 0, 1 or 2: with respect to x,
    or along a tangent T (k x m), dy/dx·T and Tᵀ·d²y/dx²·T, of which m columns pass through the network instead of k."""
    # Input and output scales are folded into the first and last weights; the shift stays, for the digits' sake.
    weights = [np.asarray(w, dtype=float) for w in network.weights]
    weights[0] = weights[0] / np.asarray(network.input_scale)
    weights[-1] = np.reshape(network.output_scale, (-1, 1)) * weights[-1]
    a, sigma = x - _constant(network.input_shift), activation_of(network.activation).derivatives
    slopes, curvatures = [], []
    for weight, bias in zip(weights[:-1], network.biases[:-1], strict=True):
        a, slope, curvature = sigma(ca, ca.mac(_constant(weight), a, _constant(bias)), 2)  # unused ones never enter
        slopes.append(slope)
        curvatures.append(curvature)
    layers, biases = list(zip(weights[:-1], slopes, curvatures, strict=True)), network.output_scale * network.biases[-1]
    return [_value(layers, a, weights[-1][[k]], biases[[k]], order, tangent) for k in outputs]


def _value(
    layers: Sequence[tuple[np.ndarray, ca.MX, ca.MX]],
    a: ca.MX,
    last: np.ndarray,
    bias: np.ndarray,
    order: int,
    tangent: ca.MX | None,
) -> NetworkValue:
    """An output by its weights (1, neurons) of the activations of the last hidden layer; of every layer there are
    weights, σ' and σ''."""
    value, r, adjoints = ca.mac(_constant(last), a, _constant(bias)), _constant(last.T), []
    if order == 0:
        return NetworkValue(value)
    for weight, slope, _ in layers[::-1]:
        adjoints.append(r)
        r = ca.mtimes(_constant(weight.T), r * slope)
    gradient = r.T if tangent is None else ca.mtimes(r.T, tangent)
    if order == 1:
        return NetworkValue(value, gradient, input_gradient=r.T)

    columns = gradient.shape[1]
    hessian = ca.MX.zeros(columns, columns)
    for (weight, slope, curvature), adjoint in zip(layers, adjoints[::-1], strict=True):
        Z = _constant(weight) if tangent is None else ca.mtimes(_constant(weight), tangent)
        hessian = ca.mac(Z.T, Z * ca.repmat(adjoint * curvature, 1, columns), hessian)
        tangent = Z * ca.repmat(slope, 1, columns)
    return NetworkValue(value, gradient, hessian, input_gradient=r.T)


def stack(values: Sequence[NetworkValue], order: int) -> Output:
    """Values of m networks below each other, with their derivatives up to the order."""
    m = len(values)
    return Output(
        ca.vertcat(*(v.value for v in values)),
        ca.vertcat(*(v.gradient for v in values)) if order > 0 else ca.MX(),
        ca.reshape(ca.horzcat(*(v.hessian for v in values)), 36, m).T if order > 1 and m else ca.MX(),
    )
