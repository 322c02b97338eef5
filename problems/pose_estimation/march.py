"""Frames that pose estimation leaves unsolved, each solved alone from the pose of a solved neighbour.

All frames in one problem share step lengths and regularisation: a few hard ones use up the iterations of all.
Neighbouring frames have neighbouring poses, so a frame beside a solved one starts near its own solution.
"""

from __future__ import annotations

from collections import deque

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array

SOLVED_N = 0.01  # norm of the residuals of a solved frame


def march(solver: ca.Function, x: Array, wanted: Array, close: np.ndarray, lower: Array, upper: Array) -> int:
    """Solve frames (rows of x (n, f)) alone, outwards from those close to a solution; returns IPOPT iterations.

    solver: nlpsol of one frame with the parameters wanted (n, p) and the objective ½|r|², r in N. close (n,): frames
    that start from where they are, any other from a solved neighbour. x is changed in place where a frame is solved.
    """
    iterations = 0
    solved = np.zeros(len(x), dtype=bool)
    waiting = deque((k, k) for k in np.flatnonzero(close))
    while waiting:
        start, frame = waiting.popleft()
        if not 0 <= frame < len(x) or solved[frame]:
            continue
        answer, spent = solve_alone(solver, x[start], wanted[frame], lower, upper)
        iterations += spent
        if answer is not None:
            x[frame], solved[frame] = answer, True
            waiting.extend([(frame, frame - 1), (frame, frame + 1)])
    return iterations


def solve_alone(solver: ca.Function, x: Array, wanted: Array, lower: Array, upper: Array) -> tuple[Array | None, int]:
    """One frame from x (f,): its solution, None if there is none to `SOLVED_N`, and IPOPT's iterations."""
    answer = solver(x0=np.clip(x, lower, upper), p=wanted, lbx=lower, ubx=upper)
    stats = solver.stats()
    solved = stats["success"] and np.sqrt(2.0 * float(answer["f"])) < SOLVED_N
    return np.asarray(answer["x"]).ravel() if solved else None, int(stats["iter_count"])
