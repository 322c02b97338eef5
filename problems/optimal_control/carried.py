"""How far loads and held pose parameters of a solution may be off, root mean square over the cycle, and why one is not
solved."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import Array, load_unit, pose_index
from casadi_contact.optimisation import pose_bounds
from casadi_contact.quantities import three_digits
from problems.optimal_control.problem import HELD, OptimalControl
from problems.optimal_control.solve import ControlResult

CARRIED = 0.01  # of the cycle's largest load or excursion: beyond it they are others than those wanted or found


def furthest_off(names: Sequence[str], errors: Array, loads: Array) -> str:
    """Which of the errors (points, L) [N, N·mm] is furthest beyond `CARRIED` of the largest load (points, L) in its
    unit; "" where none is beyond."""
    rms, largest = np.sqrt(np.mean(errors**2, axis=0)), np.abs(loads).max(axis=0)
    said = {}
    for unit in ("N", "N·mm"):
        columns = [column for column, name in enumerate(names) if load_unit(name) == unit]
        worst, allowed = max(columns, key=lambda column: rms[column]), CARRIED * largest[columns].max()
        if not rms[worst] <= allowed:
            text = (
                f"{names[worst]} is off by {three_digits(rms[worst])} {unit} (RMS), expected {three_digits(allowed)} "
                f"{unit} at most, {100.0 * CARRIED:g} % of the cycle's largest"
            )
            said[text] = rms[worst] / allowed if allowed else math.inf
    return max(said, key=lambda text: said[text], default="")


def held_off(held: Sequence[str], errors: Array, wanted: Array) -> str:
    """Which held pose parameter is furthest beyond what it may be off, "" where none is: `CARRIED` of the largest
    excursion in its unit, or what weighs as a force off by 1 N where that is more.

    errors, wanted: (points, h) [mm, rad].
    """
    rms, excursions = np.sqrt(np.mean(errors**2, axis=0)), np.ptp(wanted, axis=0)
    said = {}
    for kind, weighs in HELD.items():
        columns = [column for column, name in enumerate(held) if name.startswith(kind)]
        if not columns:
            continue
        worst = max(columns, key=lambda column: rms[column])
        allowed = max(CARRIED * excursions[columns].max(), weighs)
        if not rms[worst] <= allowed:
            said[
                f"{held[worst]} is off by {_in_words(kind, rms[worst])} (RMS), expected {_in_words(kind, allowed)} "
                "at most"
            ] = rms[worst] / allowed
    return max(said, key=lambda text: said[text], default="")


def _in_words(kind: str, value: float) -> str:
    return f"{three_digits(np.degrees(value))} degrees" if kind == "r" else f"{three_digits(value)} mm"


def missed(problem: OptimalControl, result: ControlResult) -> str:
    """Why the motion found is no answer, "" where it is: IPOPT has not ended at a solution, or its least cost leaves a
    wanted load uncarried (`furthest_off`) or a held pose parameter elsewhere (`held_off`), as where steadiness
    outweighs them, or what is held leaves the learned range."""
    if not result.converged:
        return (
            f"IPOPT ended after {result.iterations} iterations ({result.ipopt_status}), expected a solution: give more "
            f"--intervals than {problem.intervals}"
        )
    cure = f"give less --steadiness, or more --intervals than {problem.intervals}"
    if off := furthest_off(problem.model.load_names, result.load_error, result.loads - result.load_error):
        return f"of the wanted loads {off}: {cure}"
    wanted = problem.wanted.at(problem.wanted.time_s[0] + problem.times)[1]
    off = held_off(tuple(problem.wanted.held), result.held_error, wanted)
    low, high = pose_bounds(problem.model)
    columns = [pose_index(name) for name in problem.wanted.held]
    if ((wanted < low[columns]) | (wanted > high[columns])).any():
        cure = "the cycle asks for more than the model has learned; give one within that, or its foundation (--scene)"
    return off and f"of the held pose parameters {off}: {cure}"
