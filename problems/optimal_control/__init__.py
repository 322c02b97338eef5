"""Optimal control of a joint by direct collocation: build the transcribed problem, solve it.

Run ``python -m problems.optimal_control --help``.
"""

from problems.optimal_control.carried import missed
from problems.optimal_control.forward import forward_load_errors, forward_poses, strays
from problems.optimal_control.problem import OptimalControl, build
from problems.optimal_control.solve import ControlResult, solve, start_values
from problems.optimal_control.wanted_cycle import WantedCycle, cycle_of, own_cycle, simulated_cycle

__all__ = [
    "ControlResult",
    "OptimalControl",
    "WantedCycle",
    "build",
    "cycle_of",
    "forward_load_errors",
    "forward_poses",
    "missed",
    "own_cycle",
    "simulated_cycle",
    "solve",
    "start_values",
    "strays",
]
