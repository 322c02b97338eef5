"""Muscle-driven forward simulation of a walking cycle: activations in, motion of the knee and contact loads out.

Run ``python -m problems.muscle_driven --help``.
"""

from problems.muscle_driven.problem import MuscleDriven, build
from problems.muscle_driven.solve import Simulation, solve

__all__ = ["MuscleDriven", "Simulation", "build", "solve"]
