"""Archard wear of an insert over a cycle of poses, on an elastic foundation's elements.

Run ``python -m problems.wear --help``.
"""

from problems.wear.cycle import simulated_poses
from problems.wear.problem import CYCLES, WEAR_FACTOR, PatchWear, archard_wear, volume_mm3

__all__ = ["CYCLES", "WEAR_FACTOR", "PatchWear", "archard_wear", "simulated_poses", "volume_mm3"]
