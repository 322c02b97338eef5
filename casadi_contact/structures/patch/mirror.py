"""Networks of a joint that is its own mirror image: those of one side are learned, the other's are reflections."""

from __future__ import annotations

from dataclasses import replace

from casadi_contact.conventions import REFLECTION, WRENCH_NAMES
from casadi_contact.network import Network


def reflected(network: Network, columns: tuple[int, ...], component: str | None) -> Network:
    """x -> ±network(S·x), for a network of these columns of a pose; the sign is that of S for a wrench component."""
    signs = REFLECTION[list(columns)]
    sign = 1.0 if component is None else float(REFLECTION[WRENCH_NAMES.index(component)])
    return replace(
        network,
        input_shift=network.input_shift * signs,
        weights=(network.weights[0] * signs, *network.weights[1:-1], sign * network.weights[-1]),
        biases=(*network.biases[:-1], sign * network.biases[-1]),
    )
