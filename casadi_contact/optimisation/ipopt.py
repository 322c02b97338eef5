"""IPOPT as every problem here uses it: its settings, and what became of a solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from casadi_contact.core.interrupts import was_interrupted

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_INTERRUPTED = "User_Requested_Stop"  # what becomes of Ctrl-C in CasADi's IPOPT,
_THROWN = "NonIpopt_Exception_Thrown"  # and of Ctrl-C while it evaluates a function, as of any error there


def ipopt_options(
    *, tolerance: float = 1e-8, max_iterations: int = 300, print_level: int = 0, **more: Any
) -> dict[str, Any]:
    """Options of ``casadi.nlpsol`` or ``Opti.solver("ipopt", ...)``: quiet, with the exact Hessian that a surrogate's
    function gives; more: any other option of IPOPT by its name."""
    ipopt = {
        "print_level": print_level,
        "sb": "yes",
        "max_iter": max_iterations,
        "tol": tolerance,
        "hessian_approximation": "exact",
        **more,
    }
    return {"ipopt": ipopt, "print_time": False}


@dataclass(frozen=True)
class IpoptOutcome:
    """IPOPT's own word for how it ended, and its iterations."""

    status: str
    iterations: int

    @classmethod
    def of(cls, solver: ca.Function) -> IpoptOutcome:
        """What the last call of a solver came to; raises KeyboardInterrupt for one that Ctrl-C ended."""
        stats = solver.stats()
        if stats["return_status"] == _INTERRUPTED or (stats["return_status"] == _THROWN and was_interrupted()):
            raise KeyboardInterrupt
        return cls(str(stats["return_status"]), int(stats["iter_count"]))

    @property
    def solved(self) -> bool:
        """True where IPOPT met its tolerance, or its acceptable one."""
        return self.status in SOLVED
