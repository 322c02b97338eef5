"""Muscle and contact forces of a knee together, from inverse dynamics: build a problem, solve it.

Run ``python -m problems.muscle_contact --help``.
"""

from problems.muscle_contact.problem import BALANCED, FREE, LEAST_SQUARES, RESERVE_SIZES, MuscleContact, build
from problems.muscle_contact.solve import MuscleContactResult, solve

__all__ = [
    "BALANCED",
    "FREE",
    "LEAST_SQUARES",
    "RESERVE_SIZES",
    "MuscleContact",
    "MuscleContactResult",
    "build",
    "solve",
]
