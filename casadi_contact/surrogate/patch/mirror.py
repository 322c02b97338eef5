"""Networks of a joint that is its own mirror image: those of one side are learned, the other's are reflections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casadi_contact.core.conventions import REFLECTION, WRENCH_NAMES
from casadi_contact.networks.network import Network


def reflected(network: Network, columns: tuple[int, ...], components: Sequence[str | None]) -> Network:
    """x -> ±network(S·x), for a network of these columns of a pose; the sign of each output is that of S for its wrench
    component, 1 without."""
    signs = REFLECTION[list(columns)]
    sign = np.array([1.0 if k is None else REFLECTION[WRENCH_NAMES.index(k)] for k in components])
    return replace(
        network,
        input_shift=network.input_shift * signs,
        weights=(network.weights[0] * signs, *network.weights[1:-1], sign[:, None] * network.weights[-1]),
        biases=(*network.biases[:-1], sign * network.biases[-1]),
    )


def equal_networks(a: Network, b: Network) -> bool:
    """True where two networks are the same, number by number."""
    if (a.hidden, a.activation, a.output_scale) != (b.hidden, b.activation, b.output_scale):
        return False
    arrays = [(n.input_shift, n.input_scale, *n.weights, *n.biases) for n in (a, b)]
    return all(np.array_equal(x, y) for x, y in zip(*arrays, strict=True))
