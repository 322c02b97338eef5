"""Muscle and contact forces of a knee together, from inverse dynamics: build a problem, solve it.

Run ``python -m problems.muscle_contact --help``.
"""

from problems.muscle_contact.extensor import Extensor, load_extensor
from problems.muscle_contact.problem import BALANCED, FREE, LEAST_SQUARES, RESERVE_SIZES, MuscleContact, build
from problems.muscle_contact.solve import MuscleContactResult, solve
from problems.muscle_contact.synergies import SYNERGIES, driven_by_synergies
from problems.muscle_contact.with_patella import build_with_patella, fitted_to_arms

__all__ = [
    "BALANCED",
    "FREE",
    "LEAST_SQUARES",
    "RESERVE_SIZES",
    "SYNERGIES",
    "Extensor",
    "MuscleContact",
    "MuscleContactResult",
    "build",
    "build_with_patella",
    "driven_by_synergies",
    "fitted_to_arms",
    "load_extensor",
    "solve",
]
