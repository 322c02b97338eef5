"""Design of an insert: dish radii with the lowest peak pressure over a cycle at bounded laxity: build, solve.

Run ``python -m problems.design --help``.
"""

from problems.design.dish import DishContact
from problems.design.problem import Bounds, Design, build
from problems.design.solve import DesignResult, solve

__all__ = ["Bounds", "Design", "DesignResult", "DishContact", "build", "solve"]
