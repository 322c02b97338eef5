"""Pressure over the fixed surface in one pose, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class PressureMap:
    """One patch: centres_mm (m, 3), areas_mm2 (m,) and pressures_mpa (m,) of its elements, fixed frame."""

    patch: str
    centres_mm: Array
    areas_mm2: Array
    pressures_mpa: Array

    @property
    def forces_n(self) -> Array:
        """p·A (m,) of each element [N]."""
        return self.pressures_mpa * self.areas_mm2

    @property
    def centre_mm(self) -> Array | None:
        """Centre of pressure Σ p·A·c / Σ p·A (3,), None out of contact."""
        force = self.forces_n
        return np.asarray(force @ self.centres_mm / force.sum()) if force.any() else None
