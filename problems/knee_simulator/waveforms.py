"""What drives a knee simulator: flexion, axial force, anterior-posterior force and internal-external torque.

Each waveform is a smooth periodic formula of our own over the share p of the cycle,

    w(p) = base + Σ_k height_k·exp((cos 2π(p - centre_k) - 1)/(2π·width_k)²),

a sum of bumps with standard deviation width, with the magnitudes of ISO 14243-1 (axial force 168 to about 2600 N with
two peaks, flexion 0 to 58 degrees, anterior-posterior force -265 to 110 N, torque -1 to 6 N·m).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Waveform:
    """base, and bumps (height, centre, width), centre and width as shares of the cycle."""

    base: float
    bumps: tuple[tuple[float, float, float], ...] = ()

    def at(self, share: Any) -> Any:
        """Value at a share of the cycle: a number, a NumPy array or a CasADi expression."""
        library: Any = ca if isinstance(share, ca.SX | ca.MX) else np
        total = self.base + 0.0 * share
        for height, centre, width in self.bumps:
            nearness = library.cos(2.0 * np.pi * (share - centre)) - 1.0
            total = total + height * library.exp(nearness / (2.0 * np.pi * width) ** 2)
        return total

    def scaled(self, factor: float) -> Waveform:
        """The same course, factor times as large."""
        return Waveform(factor * self.base, tuple((factor * h, c, w) for h, c, w in self.bumps))


@dataclass(frozen=True)
class Waveforms:
    """flexion_deg (positive: rz = -flexion); axial_n presses the bodies together; ap_n, on the moving body, positive
    posterior (as an anterior pull on the tibia); ie_nmm, on the moving body about y, positive external for the tibia.
    """

    flexion_deg: Waveform
    axial_n: Waveform
    ap_n: Waveform
    ie_nmm: Waveform

    def with_loads_scaled(self, factor: float) -> Waveforms:
        """The same flexion under factor times the loads; raises ValueError for a factor that is not positive."""
        if not 0.0 < factor < np.inf:
            raise ValueError(f"load scale is {factor}, expected a positive number")
        loads = {name: getattr(self, name).scaled(factor) for name in ("axial_n", "ap_n", "ie_nmm")}
        return replace(self, **loads)

    @classmethod
    def constant(cls, flexion_deg: float, axial_n: float, ap_n: float = 0.0, ie_nmm: float = 0.0) -> Waveforms:
        """A joint held at one flexion under constant loads."""
        return cls(Waveform(flexion_deg), Waveform(axial_n), Waveform(ap_n), Waveform(ie_nmm))


WALKING = Waveforms(
    flexion_deg=Waveform(0.5, ((14.5, 0.15, 0.055), (3.0, 0.37, 0.08), (57.0, 0.72, 0.085))),
    axial_n=Waveform(168.0, ((2150.0, 0.13, 0.050), (700.0, 0.27, 0.080), (2310.0, 0.45, 0.065))),
    ap_n=Waveform(0.0, ((110.0, 0.05, 0.030), (-160.0, 0.16, 0.050), (-265.0, 0.50, 0.070))),
    ie_nmm=Waveform(0.0, ((1000.0, 0.12, 0.050), (-6000.0, 0.47, 0.075))),
)
