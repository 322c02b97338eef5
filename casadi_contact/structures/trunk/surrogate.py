"""The trunk surrogate: the patch surrogate (`structures.patch`) whose ratios share their hidden neurons.

A patch, or part of one, has a network of its root load and one whose outputs are all its ratios: these are smooth
functions of one contact, so that neurons that describe it serve them all. Networks are named ``root_med`` and
``ratios_med``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from casadi_contact.conventions import Array
from casadi_contact.dataset import Samples
from casadi_contact.network import Network, Regression
from casadi_contact.scenes.parts import Part
from casadi_contact.scenes.scene import Scene
from casadi_contact.structures.patch.graph import PatchNetworks
from casadi_contact.structures.patch.local_pose import LocalPoses
from casadi_contact.structures.patch.mirror import reflected
from casadi_contact.structures.patch.names import is_root, root_name
from casadi_contact.structures.patch.surrogate import PatchSurrogate
from casadi_contact.structures.trunk.targets import trunk_name, trunk_outputs, trunk_regressions
from casadi_contact.training.growth import widen


class TrunkSurrogate(PatchSurrogate):
    """Root load network and ratio trunk per patch; NumPy evaluation, and CasADi functions from `Surrogate`."""

    structure = "trunk"
    title = "trunk surrogate"
    budget_shares: ClassVar[Mapping[str, float]] = {"ratios": 0.2}

    @classmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """A root, and a trunk where the scene's loads need ratios, of every part; each of the free columns of the local
        pose."""
        names = [*(root_name(part.name) for part in scene.parts), *trunk_outputs(scene)]
        return dict.fromkeys(names, len(scene.pose_space.free))

    @classmethod
    def network_outputs(cls, scene: Scene) -> dict[str, int]:
        """1 for roots without spots, the number of ratios for trunks."""
        ratios = {name: len(components) for name, components in trunk_outputs(scene).items()}
        return {name: ratios.get(name, 1) for name in cls.network_inputs(scene)}

    @staticmethod
    def regressions(samples: Samples) -> list[Regression]:
        """See `trunk_regressions`."""
        return trunk_regressions(samples)

    @classmethod
    def twins(cls, scene: Scene) -> dict[str, str]:
        """Of a symmetric joint the networks of the second part: mirror images of those of the first. None where the
        scene asks for other loads of one side, whose trunk gives other ratios then."""
        if not scene.symmetric:
            return {}
        first, second = (part.name for part in scene.parts)
        of_first, of_second = (trunk_outputs(scene).get(trunk_name(part)) for part in (first, second))
        if of_first != of_second:
            return {}
        trunks = {trunk_name(second): trunk_name(first)} if of_first else {}
        return {root_name(second): root_name(first), **trunks}

    @staticmethod
    def reflection(name: str, network: Network, scene: Scene) -> Network:
        """The twin `name` of a network: its reflection in the plane z = 0."""
        return reflected(network, scene.pose_space.free, trunk_outputs(scene).get(name, (None,)))

    @staticmethod
    def starts(hidden: Mapping[str, tuple[int, ...]], made: Mapping[str, Mapping[str, Network]]) -> dict[str, Network]:
        """The root networks of a patch surrogate of the same samples, widened, where one was made and they fit."""
        roots = made.get("patch", {}).items()
        found = {name: root for name, root in roots if is_root(name) and name in hidden}
        return {name: widen(root, hidden[name], seed=0) for name, root in found.items() if root.hidden <= hidden[name]}

    @staticmethod
    def ratio_network(part: str, component: str) -> str:
        """The part's trunk, for every ratio."""
        return trunk_name(part)

    def _ratios(self, at: LocalPoses, part: Part, components: Sequence[str]) -> dict[str, tuple[Array, Array]]:
        if not components:
            return {}
        name = trunk_name(part.name)
        known = trunk_outputs(self.scene)[name]
        values, slopes = self._network(name, at)
        if len(known) == 1:
            return {known[0]: (values, slopes)}
        columns = {k: known.index(k) for k in components}
        return {k: (values[:, m], slopes[:, m] if len(at.by_pose) else slopes) for k, m in columns.items()}

    def _part_networks(self, part: Part, root: Network) -> PatchNetworks:
        name, normal = trunk_name(part.name), part.normal
        trunk = self.networks.get(name)
        together = None if trunk is None else (trunk, trunk_outputs(self.scene)[name])
        return PatchNetworks(part.name, part.anchor_mm, normal.component, root, {}, sign=normal.sign, together=together)
