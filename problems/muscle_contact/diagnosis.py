"""Why frames are not what they should be: infeasible, outside the learned range, or not found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.verification import Verdict
from problems.common.learned_range import reasons
from problems.muscle_contact.knee_coordinates import coordinate_unit
from problems.muscle_contact.problem import RESERVE_SIZES, MuscleContact
from problems.muscle_contact.solve import MuscleContactResult


def diagnose(problem: MuscleContact, result: MuscleContactResult, verdict: Verdict) -> MuscleContactResult:
    """The result with a reason for every frame that is unsolved, overloaded or not verified.

    not found      IPOPT stopped, or left the balance open
    infeasible     solved, but only by reserves above their size: the muscles at their bounds and contact, which only
                   pushes, leave that much of a coordinate (by the conditions of optimality, which IPOPT met)
    outside ...    of the learned range, by how much in what; the foundation (``--scene``) knows no such range
    """
    reason = result.reason.copy()
    for k in np.flatnonzero(~result.converged):
        reason[k] = f"not found: {reason[k]}"
    for k in np.flatnonzero(result.converged & result.overloaded):
        over = [
            f"{abs(curve[k]):.2g} {coordinate_unit(name)} of {name}"
            for name, curve in result.reserves.items()
            if abs(curve[k]) > RESERVE_SIZES[name]
        ]
        reason[k] = f"infeasible: muscles and contact leave {', '.join(over)} to reserves"
    beyond = reasons(problem.contact_model, result.poses, verdict)
    both = (reason != "") & (beyond != "")
    reason = np.where(both, reason + "; " + beyond, np.where(reason != "", reason, beyond))
    return replace(result, reason=reason)
