"""Optimal control with contact in the cost: a squat of a planar leg, least activation against medial contact force.

Run ``python -m problems.squat --help``.
"""

from problems.squat.leg import Body, LegMechanics
from problems.squat.problem import Squat, build
from problems.squat.solve import SquatResult, trade_off

__all__ = ["Body", "LegMechanics", "Squat", "SquatResult", "build", "trade_off"]
