"""Why frames are not what they should be: infeasible, outside the learned range, or not found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casadi_contact.core.quantities import two_digits
from casadi_contact.optimisation.knee import coordinate_unit
from casadi_contact.optimisation.verification.verdict import Verdict
from problems.common.learned_range import reasons
from problems.muscle_contact.problem import RESERVE_SIZES, MuscleContact
from problems.muscle_contact.proof import SidesApart, least_overload
from problems.muscle_contact.solve import MuscleContactResult

_RIGID_N = 0.1


def diagnose(problem: MuscleContact, result: MuscleContactResult, verdict: Verdict) -> MuscleContactResult:
    """The result with a reason for every frame that is unsolved, overloaded or not verified.

    not found      IPOPT stopped, or left the balance open
    infeasible     solved, but only by reserves above their size, and a linear program proves that no activations and no
                   contact forces at that pose do without (`proof`); with compliant tendons or a patella, which it
                   does not know, nothing is proved
    overloaded     solved likewise, but muscles and contact could do without: rules that the program does not know
                   forbid it, or activations near their bounds cost more than reserves
    outside ...    of the learned range, by how much in what; the foundation (``--scene``) knows no such range
    """
    reason = result.reason.copy()
    for k in np.flatnonzero(~result.converged):
        reason[k] = f"not found: {reason[k]}"
    for k in np.flatnonzero(result.converged & result.overloaded):
        over = [
            f"{two_digits(abs(curve[k]))} {coordinate_unit(name)} of {name}"
            for name, curve in result.reserves.items()
            if abs(curve[k]) > RESERVE_SIZES[name]
        ]
        said = [f"muscles and contact leave {', '.join(over)} to reserves"] if over else []
        if result.soleus is not None and result.soleus[k] > 1.0:
            said.append(f"the ankle asks {result.soleus[k]:.2g} times its greatest force of soleus")
        reason[k] = _overload(problem, result, int(k), " and ".join(said))
    beyond = reasons(problem.contact_model, result.poses, verdict)
    both = (reason != "") & (beyond != "")
    reason = np.where(both, reason + "; " + beyond, np.where(reason != "", reason, beyond))
    return replace(result, reason=reason)


def _overload(problem: MuscleContact, result: MuscleContactResult, frame: int, left: str) -> str:
    """What is left to reserves in a frame, and whether a linear program says that it has to be."""
    capacity, forces = problem.capacity, result.muscle_forces_n[frame]
    rigid = capacity.active_n[frame] * result.activations[frame] + capacity.passive_n[frame]
    model, elastic = problem.contact_model, np.abs(forces - rigid).max() > _RIGID_N
    if problem.extensor is not None or elastic or not isinstance(model, SidesApart):
        return f"infeasible: {left} (not proved)"
    least = least_overload(problem, model, result.poses[frame], frame)
    if least > 1.0:
        return f"infeasible: {left}, proved to give at least {least:.2g} times their size at this pose"
    return (
        f"overloaded: {left}, and could do without, but not by all rules (co-contraction, least activation, activation "
        "dynamics, synergies) or at the price of activations"
    )
