"""Muscle and contact with the patella between them: tibiofemoral and patellofemoral contact in one problem."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.optimisation.muscle_walk import MuscleWalk
from casadi_contact.optimisation.verification.verdict import Verdict, judge, own_model
from problems.muscle_contact.extensor import Extensor, quadriceps
from problems.muscle_contact.problem import MuscleContact, build
from problems.muscle_contact.solve import MuscleContactResult

_SAME_ARM_MM = 0.1
_MOST_MOVES = 10


def fitted_to_arms(extensor: Extensor, contact_model: SymbolicContact, walk: MuscleWalk) -> Extensor:
    """The extensor mechanism moved forward so far that the quadriceps' mean arm of flexion over the walk, all heads
    alike, is that of the walk's files: geometry alone, no measured force.

    Raises ValueError for a walk without arms of flexion, and where no place of the groove gives theirs."""
    walk.check_has(("knee_flexion",))
    own = walk.arms["knee_flexion"][:, quadriceps(walk.muscles.names)].mean()
    poses, ahead_mm = shear_free_poses(contact_model, walk.ry, walk.rz), 0.0
    for _ in range(_MOST_MOVES):
        lacks_mm = 1e3 * float(own - extensor.moved_forward(ahead_mm).arms(poses)["knee_flexion"].mean())
        if abs(lacks_mm) < _SAME_ARM_MM:
            return extensor.moved_forward(ahead_mm)
        ahead_mm += lacks_mm
    raise ValueError(
        f"walk {walk.name}: the quadriceps' mean arm of flexion is {1e3 * own:.3g} mm, which no place of the groove of "
        f"assembly {extensor.assembly.name} gives: leave it where it is (--no-fit-patella)"
    )


def build_with_patella(
    contact_model: SymbolicContact, walk: MuscleWalk, extensor: Extensor, **settings: Any
) -> MuscleContact:
    """`build` with the quadriceps through the patella, and as its first problem the one in which they pull along the
    arms that the extensor mechanism gives them at some flexions. settings: those of `build`."""
    through = quadriceps(walk.muscles.names)
    found = extensor.arms(shear_free_poses(contact_model, walk.ry, walk.rz))
    arms = {name: table.copy() for name, table in walk.arms.items()}
    for name, table in arms.items():
        table[:, through] = found[name][:, None]
    first = build(contact_model, replace(walk, arms=arms), **settings)
    return replace(build(contact_model, walk, extensor=extensor, **settings), first=first)


def patella_verdict(problem: MuscleContact, result: MuscleContactResult) -> Verdict | None:
    """What the elastic foundation says of the patella in its groove; None for a problem without one."""
    if problem.extensor is None or result.patella is None:
        return None
    model = problem.extensor.contact.model
    return judge(model, result.patella.contact_poses, result.converged, own_model(model.scene))
