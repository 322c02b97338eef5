"""The networks of a patch: their names, outputs and inputs, and their mirror images.

A parameter of the pose that the scene locks or ties never varies in the samples: networks have no input for it. A
surrogate gives them one of weight zero (`patch_networks`), so that every network is a function of a whole local pose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import REFLECTION, WRENCH_NAMES, Array
from casadi_contact.networks.network import Network
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PatchNetworks:
    """The networks of one patch, each of a whole local pose (6): root load s, and ratios ρ_k of the wrench
    ``components`` (None where there are none). The sensitive component of the wrench, if any, is sign·N.
    """

    name: str
    anchor_mm: Array
    sign: float
    root: Any
    ratios: Any
    components: tuple[str, ...]
    columns: list[int]
    """Where the components stand in a wrench."""
    own: Array
    """Of each wrench component (6,), its share of the normal load itself: the sign for the sensitive one, else 0."""


def root_name(patch: str) -> str:
    """Name of the root load network of a patch: root_med."""
    return f"root_{patch}"


def ratios_name(patch: str) -> str:
    """Name of the network of all ratios of a patch: ratios_med."""
    return f"ratios_{patch}"


def patch_components(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Of every patch: the wrench components whose ratio to the normal load the scene's loads need, perhaps none."""
    selection = scene.selection(scene.load_names)
    return {
        patch.name: tuple(
            name for k, name in enumerate(WRENCH_NAMES) if selection[:, p, k].any() and name != patch.normal.component
        )
        for p, patch in enumerate(scene.patches)
    }


def ratio_outputs(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Wrench components whose ratios the scene's loads need, by the name of the network that gives them."""
    components = patch_components(scene)
    return {ratios_name(patch): names for patch, names in components.items() if names}


def patch_networks(scene: Scene, networks: Mapping[str, Network]) -> list[PatchNetworks]:
    """The networks of every patch."""
    patches = []
    for patch, components in zip(scene.patches, patch_components(scene).values(), strict=True):
        of_patch = (networks.get(name) for name in (root_name(patch.name), ratios_name(patch.name)))
        root, ratios = (net and with_all_inputs(net, scene.pose_space.free) for net in of_patch)
        normal, columns = patch.normal, [WRENCH_NAMES.index(name) for name in components]
        own = np.array([normal.sign if name == normal.component else 0.0 for name in WRENCH_NAMES])
        patches.append(PatchNetworks(patch.name, patch.anchor_mm, normal.sign, root, ratios, components, columns, own))
    return patches


def with_all_inputs(network: Network, columns: Sequence[int], count: int = 6) -> Network:
    """The same function of so many inputs, for a network of these columns: the others weigh nothing."""
    if len(columns) == count:
        return network
    shift, scale, weights = np.zeros(count), np.ones(count), np.zeros((len(network.biases[0]), count))
    shift[list(columns)], scale[list(columns)] = network.input_shift, network.input_scale
    weights[:, list(columns)] = network.weights[0]
    return replace(network, input_shift=shift, input_scale=scale, weights=(weights, *network.weights[1:]))


def reflected(network: Network, columns: tuple[int, ...], components: Sequence[str | None]) -> Network:
    """x -> ±network(S·x), for a network of these columns of a pose; an output has S's sign of its component, else 1."""
    signs = REFLECTION[list(columns)]
    sign = np.array([1.0 if k is None else REFLECTION[WRENCH_NAMES.index(k)] for k in components])
    return replace(
        network,
        input_shift=network.input_shift * signs,
        weights=(network.weights[0] * signs, *network.weights[1:-1], sign[:, None] * network.weights[-1]),
        biases=(*network.biases[:-1], sign * network.biases[-1]),
    )
