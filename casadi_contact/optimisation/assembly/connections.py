"""What acts between the bodies of an assembly: contacts, ligaments, pulls of given tension, springs.

Lines of action are straight between two points [mm], each fixed to a body. Tensions are in N, positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, check_above_zero, finite_numbers
from casadi_contact.core.files.reading import short
from casadi_contact.networks.names import check_name


def finite_vector(what: str, value: Any, *shape: int, expected: str = "") -> Array:
    """Finite numbers of a shape; ValueError saying what is got and what is expected for anything else."""
    numbers = finite_numbers(value)
    if numbers is None or numbers.shape != shape:
        wanted = expected or f"{' × '.join(map(str, shape))} finite numbers"
        raise ValueError(f"{what} {short(repr(value))}, expected {wanted}")
    return numbers


@dataclass(frozen=True)
class Contact:
    """A contact model between a fixed and a moving body of an assembly; each frame (6,) [mm, rad] places the model's
    own body frame on that of the assembly. Raises ValueError for other frames, and for a name that no function can
    have."""

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
        for frame in ("fixed_frame", "moving_frame"):
            finite_vector(f"{self.name}: {frame} is", getattr(self, frame), 6)

    @property
    def function_name(self) -> str:
        """Of its loads, in CasADi and C."""
        return f"{self.name}_loads"

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of both."""
        return self.fixed, self.moving


@dataclass(frozen=True)
class Line:
    """A straight line between a point (3,) [mm] of one body and one of another. Raises ValueError for other points, and
    for other than two bodies."""

    name: str
    bodies: Sequence[str]
    points_mm: Sequence[Array]

    def __post_init__(self) -> None:
        if not isinstance(self.bodies, list | tuple) or len(self.bodies) != 2:
            raise ValueError(f"{self.name}: bodies is {self.bodies!r}, expected two names")
        finite_vector(f"{self.name}: points_mm is", self.points_mm, 2, 3)


@dataclass(frozen=True)
class Ligament(Line):
    """A nonlinear elastic bundle: tension [N] over the strain ε = length/slack_length - 1 (Blankevoort and Huiskes,
    J Biomech Eng 113 (1991) 263-269, as OpenSim's Blankevoort1991Ligament without its damping),

    0 below ε = 0,   k·ε²/(4·ε_l) up to 2·ε_l,   k·(ε - ε_l) beyond,    ε_l = 0.03, k = stiffness_n [N]

    Raises ValueError also for a stiffness or a slack length that is not above 0.
    """

    stiffness_n: float
    slack_length_mm: float
    toe_strain: float = 0.03  # ε_l

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above_zero(
            **{f"{self.name}: stiffness_n": self.stiffness_n, f"{self.name}: slack_length_mm": self.slack_length_mm}
        )

    def tension(self, length: Any) -> Any:
        """Tension [N] at a length [mm], once continuously differentiable, as a CasADi expression."""
        strain = ca.fmax(length / self.slack_length_mm - 1.0, 0.0)
        toe, straight = 0.25 * strain**2 / self.toe_strain, strain - self.toe_strain
        return self.stiffness_n * ca.if_else(strain < 2.0 * self.toe_strain, toe, straight)


@dataclass(frozen=True)
class Pull(Line):
    """A line whose tension is an input of the assembly: a muscle or an actuator."""


@dataclass(frozen=True)
class Spring:
    """Linear springs on the pose of one body in the ground: generalised forces -stiffness·(pose - rest), each (6,).
    Raises ValueError for other sizes and a negative stiffness."""

    name: str
    body: str
    stiffness: Array
    rest: Array

    def __post_init__(self) -> None:
        if (finite_vector(f"{self.name}: stiffness is", self.stiffness, 6) < 0.0).any():
            raise ValueError(f"{self.name}: stiffness is {list(self.stiffness)}, expected 0 or more")
        finite_vector(f"{self.name}: rest is", self.rest, 6)
