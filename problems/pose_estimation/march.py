"""Frames that pose estimation leaves unsolved, each solved alone from the pose of a solved neighbour.

All frames in one problem share step lengths and regularisation: a few hard ones use up the iterations of all.
Neighbouring frames have neighbouring poses, so a frame beside a solved one starts near its own solution.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.ipopt import IpoptOutcome

SOLVED_N = 0.01  # norm of the residuals of a solved frame


@dataclass(frozen=True)
class FrameSolver:
    """One frame alone: nlpsol of variables within lower and upper (f,), whose parameters are what is wanted (p,) and
    whose objective is ½|r|², r in N."""

    solver: ca.Function
    lower: Array
    upper: Array

    def solve(self, x: Array, wanted: Array) -> tuple[Array | None, int]:
        """From x (f,): the solution, None if there is none to `SOLVED_N`, and IPOPT's iterations."""
        answer = self.solver(x0=np.clip(x, self.lower, self.upper), p=wanted, lbx=self.lower, ubx=self.upper)
        outcome = IpoptOutcome.of(self.solver)
        solved = outcome.solved and np.sqrt(2.0 * float(answer["f"])) < SOLVED_N
        return np.asarray(answer["x"]).ravel() if solved else None, outcome.iterations


def march(frame_solver: FrameSolver, x: Array, wanted: Array, close: np.ndarray) -> int:
    """Solve frames (rows of x (n, f)) alone, outwards from those close to a solution; returns IPOPT iterations.

    wanted: (n, p). close (n,): frames that start from where they are, any other from a solved neighbour. x is changed
    in place where a frame is solved.
    """
    iterations = 0
    solved = np.zeros(len(x), dtype=bool)
    waiting = deque((k, k) for k in np.flatnonzero(close))
    while waiting:
        start, frame = waiting.popleft()
        if not 0 <= frame < len(x) or solved[frame]:
            continue
        answer, spent = frame_solver.solve(x[start], wanted[frame])
        iterations += spent
        if answer is not None:
            x[frame], solved[frame] = answer, True
            waiting.extend([(frame, frame - 1), (frame, frame + 1)])
    return iterations
