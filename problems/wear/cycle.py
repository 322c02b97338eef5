"""The motion whose wear is asked for."""

from __future__ import annotations

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import Array
from problems import knee_simulator


def simulated_poses(model: SymbolicContact, frames: int = 200) -> Array:
    """Poses (frames, 6) of the knee simulator's second cycle, by then periodic; the first frame again would follow."""
    motion = knee_simulator.solve(knee_simulator.build(model), cycles=2.0, frames=2 * frames + 1, tolerance=1e-7)
    return motion.poses[frames:-1]
