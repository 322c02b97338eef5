"""Settling: the pose at which contact and soft tissue carry six given loads: build a problem, solve it.

Run ``python -m problems.static_equilibrium --help``.
"""

from problems.static_equilibrium.on_model import on_model
from problems.static_equilibrium.problem import FREE, SOFT_TISSUE, StaticEquilibrium, build
from problems.static_equilibrium.search import search
from problems.static_equilibrium.solve import EquilibriumResult, solve

__all__ = ["FREE", "SOFT_TISSUE", "EquilibriumResult", "StaticEquilibrium", "build", "on_model", "search", "solve"]
