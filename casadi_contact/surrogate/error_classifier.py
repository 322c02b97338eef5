"""Where a surrogate is wrong: a small network that was shown at which poses its loads differ from the contact model's.

Samples lie where the contact model was asked for loads. Who settles or optimises on a surrogate goes where *it* carries
them: over an insert's rim, say, where no sample tells it that nothing bears there. Such poses lie between samples, and
distance from these does not tell them. The insensitive pose parameters x and the root loads s do:

    excess = STEEPNESS·(y(x, s) - half)

with y the network's answer, about -1 where the surrogate was right and 1 where it was wrong (`structures.wrong_poses`).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.graph import network_value
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.cut_off import cut_off, cut_off_expression

STEEPNESS = 8.0
LAYERS = 3  # two of them hidden


@dataclass(frozen=True)
class ErrorClassifier:
    """columns (k,) of the pose; a `Network` of k + P inputs, hidden layers of m and n neurons and one output, an array
    for each of its parts: shift and scale (k + P,), weights (m, k + P), (n, m), (1, n), biases (m,), (n,), (1,); half:
    its answer where validity is a half."""

    columns: Array
    shift: Array
    scale: Array
    weights_0: Array
    biases_0: Array
    weights_1: Array
    biases_1: Array
    weights_2: Array
    biases_2: Array
    half: float

    @classmethod
    def of(cls, columns: Array, network: Network, half: float) -> ErrorClassifier:
        """Of a network with two hidden layers and one output, whose scale goes into the last layer."""
        w, b = list(network.weights), list(network.biases)
        w[-1], b[-1] = network.output_scale * w[-1], network.output_scale * b[-1]
        return cls(columns, network.input_shift, network.input_scale, w[0], b[0], w[1], b[1], w[2], b[2], half)

    @property
    def network(self) -> Network:
        """From the pose's columns and the root loads (k + P) to y."""
        weights, biases = (
            tuple(getattr(self, f"{kind}_{layer}") for layer in range(LAYERS)) for kind in ("weights", "biases")
        )
        return Network(self.shift, self.scale, weights, biases)

    def bundle(self) -> Bundle:
        """C functions classifier_value and its like."""
        return Bundle("classifier", len(self.shift), {"where it is wrong": self.network})

    def excess(self, poses: Array, roots: Array) -> Array:
        """One column (n, 1) of poses (n, 6) with root loads (n, P)."""
        x = cut_off(np.hstack([poses[:, self.columns.astype(int)], roots]))
        return np.asarray(STEEPNESS * (self.network.value(x) - self.half))[:, None]

    def expression(self, pose: ca.MX, roots: ca.MX) -> ca.MX:
        """The same (1) of a pose (6) and root loads (P)."""
        x = cut_off_expression(ca.vertcat(pose[[int(c) for c in self.columns]], roots))
        return STEEPNESS * (network_value(self.network, x).value - self.half)
