"""Contact loads and flexion wanted over a cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import Array, pose_index
from problems import knee_simulator
from problems.knee_simulator.rig import Rig

_RZ = pose_index("rz")


@dataclass(frozen=True)
class WantedCycle:
    """time_s (n,) from 0 over one cycle; loads (n, L) as in ``load_names`` of the contact model; rz (n,) [rad]."""

    time_s: Array
    loads: Array
    rz: Array

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Loads (m, L) and rz (m,) at other times, by cubic splines."""
        spline = CubicSpline(self.time_s, np.column_stack([self.loads, self.rz]))(time_s)
        return spline[:, :-1], spline[:, -1]


def simulated_cycle(model: SymbolicContact, rig: Rig | None = None, frames: int = 401) -> WantedCycle:
    """The loads that the knee simulator's second cycle, by then periodic, carries."""
    simulator = knee_simulator.build(model, rig=rig)
    motion = knee_simulator.solve(simulator, cycles=2.0, frames=2 * frames - 1, tolerance=1e-8)
    second = slice(frames - 1, None)
    return WantedCycle(
        time_s=motion.time_s[second] - motion.time_s[frames - 1],
        loads=model(motion.poses[second]),
        rz=motion.poses[second, _RZ],
    )
