"""The networks of a patch: their names, outputs and inputs, and their mirror images.

A parameter of the pose that the scene locks or ties never varies in the samples: networks have no input for it. A
surrogate gives them one of weight zero (`with_all_inputs`), so that every network is a function of a whole local pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.core.conventions import REFLECTION, WRENCH_NAMES, Array
from casadi_contact.networks.network import Network
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PatchNetworks:
    """The networks of one patch or part, each of a whole local pose (6): root load s_p; ratios ρ_pk of the wrench
    ``components``, None where none is needed. ``sensitive`` is the wrench component that is sign·N; None where every
    component is a ratio.
    """

    name: str
    anchor_mm: Array
    sensitive: str | None
    root: Network
    ratios: Network | None
    components: tuple[str, ...]
    sign: float = -1.0


def root_name(part: str) -> str:
    """Name of the root load network of a patch or part: root_med."""
    return f"root_{part}"


def ratios_name(part: str) -> str:
    """Name of the network of all ratios of a patch or part: ratios_med."""
    return f"ratios_{part}"


def part_components(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Of every part: the wrench components whose ratio to the normal load the scene's loads need, perhaps none."""
    selection = scene.part_selection(scene.load_names)
    return {
        part.name: tuple(
            name for k, name in enumerate(WRENCH_NAMES) if selection[:, p, k].any() and name != part.normal.component
        )
        for p, part in enumerate(scene.parts)
    }


def ratio_outputs(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Wrench components whose ratios the scene's loads need, by the name of the network that gives them."""
    components = part_components(scene)
    return {ratios_name(part): names for part, names in components.items() if names}


def with_all_inputs(network: Network, columns: Sequence[int]) -> Network:
    """The same function of a whole local pose (6), for a network of these columns: the other inputs weigh nothing."""
    if len(columns) == 6:
        return network
    shift, scale, weights = np.zeros(6), np.ones(6), np.zeros((len(network.biases[0]), 6))
    shift[list(columns)], scale[list(columns)] = network.input_shift, network.input_scale
    weights[:, list(columns)] = network.weights[0]
    return replace(network, input_shift=shift, input_scale=scale, weights=(weights, *network.weights[1:]))


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
