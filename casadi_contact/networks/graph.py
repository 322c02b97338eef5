"""Networks as CasADi MX expressions, layer by layer: matrix nodes keep the graph small (about 13 instructions), and
CasADi differentiates it to any order. Nothing is ever expanded to scalars."""

from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network


def nan_marker(poses: ca.MX) -> ca.MX:
    """0 for every finite pose (a column of 6 x n), NaN for any other; shape (1 x n), derivatives zero."""
    # |sin| <= 1, and the sine of infinity is NaN. CasADi would simplify 0·pose to 0.
    return ca.floor(0.5 + 0.01 * ca.sum1(ca.sin(poses)))


def nan_if_not_finite(pose: ca.MX, values: ca.MX) -> ca.MX:
    """Values of a pose (6), NaN in every entry and derivative where it holds NaN or infinity; others stay as they are.

    ca.fmax, ca.fmin and comparisons drop NaN, so that it would reach some of the outputs only.
    """
    return values * (1.0 + nan_marker(pose))


def network_value(network: Network, x: Any) -> Any:
    """The outputs (m) of a network for a column x of k inputs, in MX; for a small network in SX too."""
    # Input and output scales are folded into the first and last weights; the shift stays, for the digits' sake.
    weights = [np.asarray(w, dtype=float) for w in network.weights]
    weights[0] = weights[0] / np.asarray(network.input_scale)
    weights[-1] = np.reshape(network.output_scale, (-1, 1)) * weights[-1]
    biases = [*network.biases[:-1], network.output_scale * network.biases[-1]]
    a, sigma = x - ca.DM(network.input_shift), activation_of(network.activation).derivatives
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        (a,) = sigma(ca, ca.mac(ca.DM(weight), a, ca.DM(bias)), 0)
    return ca.mac(ca.DM(weights[-1]), a, ca.DM(biases[-1]))
