"""How far the loads of a solution may be off, root mean square over the cycle, and why one is not solved."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import Array, load_unit
from casadi_contact.quantities import three_digits
from problems.optimal_control.problem import OptimalControl
from problems.optimal_control.solve import ControlResult

CARRIED = 0.01  # of the cycle's largest load: beyond it loads are others than those wanted or found


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


def missed(problem: OptimalControl, result: ControlResult) -> str:
    """Why the loads found are no answer, "" where they are: IPOPT has not ended at a solution, or its least cost leaves
    some wanted load uncarried (`furthest_off`), as where steadiness outweighs it."""
    if not result.converged:
        return (
            f"IPOPT ended after {result.iterations} iterations ({result.ipopt_status}), expected a solution: give more "
            f"--intervals than {problem.intervals}"
        )
    off = furthest_off(problem.model.load_names, result.load_error, result.loads - result.load_error)
    cure = f"give less --steadiness, or more --intervals than {problem.intervals}"
    return off and f"of the wanted loads {off}: {cure}"
