"""The elastic layer of a scene's fixed body."""

from __future__ import annotations

from dataclasses import dataclass

from casadi_contact.scenes.pressure_laws import LAWS
from casadi_contact.scenes.shapes.checks import fail, number, table_of


@dataclass(frozen=True)
class Material:
    """Elastic layer of the fixed body: Young's modulus [MPa], Poisson's ratio, thickness [mm], pressure law."""

    youngs_modulus: float
    poissons_ratio: float
    thickness: float
    law: str = "linear"

    @classmethod
    def from_table(cls, table: object) -> Material:
        """From the scene's [material]; raises ValueError naming the key at fault."""
        values = table_of("material", table, ("youngs_modulus", "poissons_ratio", "thickness", "law"), complete=True)
        if values["law"] not in tuple(LAWS):  # a list or a table is not to be looked up
            raise fail("material.law", values["law"], " or ".join(LAWS))
        return cls(
            youngs_modulus=number("material.youngs_modulus", values["youngs_modulus"], low=0.0),
            poissons_ratio=number("material.poissons_ratio", values["poissons_ratio"], low=-1.0, high=0.5),
            thickness=number("material.thickness", values["thickness"], low=0.0),
            law=values["law"],
        )
