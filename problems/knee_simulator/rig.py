"""What moves and holds the joint in a knee simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array


@dataclass(frozen=True)
class Rig:
    """What moves and holds the joint, for q = (tx, ty, tz, rx, ry): masses [kg] and moments of inertia [kg·m²] of the
    moving parts, dampers and springs. Springs are slack at rest_mm_rad."""

    mass_kg: tuple[float, float, float] = (5.0, 5.0, 5.0)
    inertia_kgm2: tuple[float, float] = (0.02, 0.02)
    damping_ns_per_mm: tuple[float, float, float] = (1.0, 5.0, 1.0)
    damping_nmms_per_rad: tuple[float, float] = (5000.0, 1000.0)
    ap_spring_n_per_mm: float = 30.0
    ie_spring_nmm_per_deg: float = 600.0
    rest_mm_rad: tuple[float, ...] = (0.0,) * 5
    axial_offset_mm: float = 5.0
    period_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mass_kg", "inertia_kgm2"):
            if not all(0.0 < value < np.inf for value in getattr(self, name)):
                raise ValueError(f"rig: {name} is {getattr(self, name)}, expected positive numbers")
        for name in ("damping_ns_per_mm", "damping_nmms_per_rad"):
            if not all(0.0 <= value < np.inf for value in getattr(self, name)):
                raise ValueError(f"rig: {name} is {getattr(self, name)}, expected numbers >= 0")
        if len(self.rest_mm_rad) != 5:
            raise ValueError(f"rig: rest_mm_rad has {len(self.rest_mm_rad)} numbers, expected 5: tx ty tz rx ry")
        if not (self.ap_spring_n_per_mm >= 0.0 and self.ie_spring_nmm_per_deg >= 0.0 and self.period_s > 0.0):
            raise ValueError("rig: a spring is negative or the period not positive, expected springs >= 0, period > 0")

    @property
    def inertia(self) -> Array:
        """Diagonal of M (5,) [t, t·mm²], so that N = t·mm/s²."""
        return np.array([*(1e-3 * m for m in self.mass_kg), *(1e3 * i for i in self.inertia_kgm2)])

    @property
    def damping(self) -> Array:
        """Diagonal c (5,) [N·s/mm, N·mm·s/rad]."""
        return np.array([*self.damping_ns_per_mm, *self.damping_nmms_per_rad])

    @property
    def stiffness(self) -> Array:
        """Diagonal k (5,) [N/mm, N·mm/rad]."""
        return np.array([self.ap_spring_n_per_mm, 0.0, 0.0, 0.0, np.degrees(self.ie_spring_nmm_per_deg)])
