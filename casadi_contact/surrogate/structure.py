"""What a structure is before it is trained: which networks it has for a scene, and what they are fitted on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from casadi_contact.networks.network import Network, Regression
from casadi_contact.scenes.scene import Scene

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples


class Structure(ABC):
    """How contact loads are shared out among networks; `Surrogate` is one whose networks are trained."""

    structure: ClassVar[str]
    title: ClassVar[str]
    """What charts call it."""
    budget_shares: ClassVar[Mapping[str, float]] = {}
    """Share of a size's budget [Gflop] that a network gets in a chart, by the start of its name; 1 for all others."""

    @staticmethod
    def fits(scene: Scene) -> bool:
        """True where this structure can stand for the scene's loads."""
        return True

    @classmethod
    @abstractmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """Every network this structure can have for a scene, with its number of inputs."""

    @classmethod
    def network_outputs(cls, scene: Scene) -> dict[str, int]:
        """The same networks, each with its number of outputs."""
        return dict.fromkeys(cls.network_inputs(scene), 1)

    @staticmethod
    @abstractmethod
    def regressions(samples: Samples) -> list[Regression]:
        """The regressions, one for each network, that samples pose."""

    @classmethod
    def twins(cls, scene: Scene) -> dict[str, str]:
        """Networks that need no training, each with the one that it is the mirror image of (`reflection`)."""
        return {}

    @staticmethod
    def reflection(name: str, network: Network, scene: Scene) -> Network:
        """The twin `name` of a network; raises ValueError for one that is not among `twins`."""
        raise ValueError(f"network {name!r} is the mirror image of none, expected one of `twins`")

    @classmethod
    @abstractmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        """Names of the networks that the loads need; raises ValueError for an unknown load."""
