"""A contact model between two bodies of an assembly."""

from dataclasses import dataclass, field

import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, finite_numbers
from casadi_contact.core.files.reading import short
from casadi_contact.networks.names import check_name


@dataclass(frozen=True)
class Contact:
    """A contact model between a fixed and a moving body of an assembly; each frame (6,) [mm, rad] places the model's
    own body frame on that of the assembly. Raises ValueError for other frames, for a name that no function can have,
    and for a scene that locks or ties pose parameters: nothing holds the bodies so."""

    name: str
    model: SymbolicContact
    fixed: str
    moving: str
    fixed_frame: Array = field(default_factory=lambda: np.zeros(6))
    moving_frame: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        try:
            check_name(self.function_name)
        except ValueError:
            raise ValueError(f"contact {self.name!r}: expected letters, digits and single underscores") from None
        self.model.scene.pose_space.check_unconstrained(f"the contact {self.name}")
        for frame in ("fixed_frame", "moving_frame"):
            numbers = finite_numbers(value := getattr(self, frame))
            if numbers is None or numbers.shape != (6,):
                raise ValueError(f"{self.name}: {frame} is {short(repr(value))}, expected 6 finite numbers")

    @property
    def function_name(self) -> str:
        """Of its loads, in CasADi and C."""
        return f"{self.name}_loads"

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of both."""
        return self.fixed, self.moving
