"""IPOPT as every problem here uses it: its settings, and what became of a solution and of each of its frames."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.interrupts import was_interrupted


class FrameOutcome(Enum):
    """What became of one frame (or row) of a problem."""

    SOLVED = "solved"
    OVERLOADED = "solved only by reserves beyond their size"
    NO_LOAD = "no load"
    NOT_SOLVED = "not solved"

    @staticmethod
    def of(solved: np.ndarray, *others: tuple[np.ndarray, FrameOutcome]) -> np.ndarray:
        """The outcome (n,) of each frame: SOLVED or NOT_SOLVED, and others where their masks (n,) are True."""
        outcome = np.full(len(solved), FrameOutcome.NOT_SOLVED, dtype=object)
        for rows, other in ((solved, FrameOutcome.SOLVED), *others):
            outcome[rows] = other
        return outcome


def ipopt_options(*, tolerance: float = 1e-8, max_iterations: int = 300, **more: Any) -> dict[str, Any]:
    """Options of ``casadi.nlpsol`` or ``Opti.solver("ipopt", ...)``: quiet, with the exact Hessian that a contact
    model's function gives; more: any other option of IPOPT by its name.

    Variables and misfits are scaled already. IPOPT would scale by the gradient at the start, which is zero far out of
    contact, and so small at the solution that the scaled tolerance is out of reach."""
    ipopt = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": max_iterations,
        "tol": tolerance,
        "hessian_approximation": "exact",
        "nlp_scaling_method": "none",
        **more,
    }
    return {"ipopt": ipopt, "print_time": False}


def settled_options(**settings: Any) -> dict[str, Any]:
    """`ipopt_options` for a start that is settled: a small barrier, so that bounds do not push it away (3 iterations in
    place of 6 to 8 where it is the solution), and a restoration that stays near it, so that it keeps contact."""
    return ipopt_options(**{"mu_init": 1e-6, "resto_penalty_parameter": 10.0, **settings})


def least_squares_options(**settings: Any) -> dict[str, Any]:
    """`settled_options` for ½|r|², r in N: gradients end below 1e-5 N², residuals below about 1e-7 N."""
    return settled_options(obj_scaling_factor=1e-3, **settings)


@dataclass(frozen=True)
class IpoptOutcome:
    """IPOPT's own word for how it ended, and its iterations."""

    status: str
    iterations: int

    @classmethod
    def of(cls, solver: ca.Function) -> IpoptOutcome:
        """How the last call of a solver ended; raises KeyboardInterrupt where Ctrl-C ended it: CasADi's IPOPT then
        stops by request, or throws while it evaluates a function, as for any error there."""
        stats = solver.stats()
        status = str(stats["return_status"])
        if status == "User_Requested_Stop" or (status == "NonIpopt_Exception_Thrown" and was_interrupted()):
            raise KeyboardInterrupt
        return cls(status, int(stats["iter_count"]))

    @property
    def solved(self) -> bool:
        """True where IPOPT met its tolerance, or its acceptable one."""
        return self.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")

    def __str__(self) -> str:
        return f"IPOPT: {self.status}, {self.iterations} iterations"


@dataclass(frozen=True, kw_only=True)
class FrameResult:
    """What every problem's result has: outcome (n,) of each frame, a `FrameOutcome`, and IPOPT's end and time."""

    outcome: np.ndarray
    ipopt: IpoptOutcome
    seconds: float = 0.0

    @property
    def solved(self) -> np.ndarray:
        """True (n,) for frames that meet their targets or balance, without overload."""
        return np.asarray(self.outcome == FrameOutcome.SOLVED)
