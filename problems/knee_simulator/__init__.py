"""A load-driven knee simulator: build its equations of motion, solve them over a cycle.

Run ``python -m problems.knee_simulator --help``.
"""

from problems.knee_simulator.problem import LOAD_SCALE, POWERS, KneeSimulator, build
from problems.knee_simulator.solve import INTEGRATORS, Simulation, solve, start_state

__all__ = ["INTEGRATORS", "LOAD_SCALE", "POWERS", "KneeSimulator", "Simulation", "build", "solve", "start_state"]
