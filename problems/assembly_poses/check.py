"""What the contact models say of an assembly's poses; frames that they deny are solved on them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.optimisation.assembly.file import load_assembly
from casadi_contact.optimisation.verification.verdict import Verdict, judge, own_model
from problems.assembly_poses.cycle import two_or_more
from problems.assembly_poses.problem import AssemblyPoses, build
from problems.assembly_poses.solve import AssemblyResult, solve


def verdicts_of(problem: AssemblyPoses, result: AssemblyResult) -> dict[str, Verdict]:
    """The verdict of each contact by name, on its scene's finest grid (`own_model`)."""
    return {
        part.name: judge(
            part.model,
            problem.assembly.contact_poses(part.name, result.poses),
            result.converged,
            own_model(part.model.scene),
            on_model=result.on_model,
        )
        for part in problem.assembly.contacts
    }


def corrected(name: str | Path, problem: AssemblyPoses, result: AssemblyResult) -> AssemblyResult:
    """The result with the frames in which a contact model differs solved on the contact models, from where they stand.

    name: of the assembly, or its file. Frames that are not solved there stay, and so do all where a contact has no
    model to ask.
    """
    verdicts = verdicts_of(problem, result)
    denied = np.any([verdict.differs for verdict in verdicts.values()], axis=0)
    if not denied.any() or not all(verdict.checked for verdict in verdicts.values()):
        return result
    began = time.perf_counter()
    rows = two_or_more(np.flatnonzero(denied), len(denied))
    on_models = load_assembly(name, contact=lambda scene: symbolic(cast(ContactModel, own_model(scene))))
    again = solve(build(on_models, problem.cycle.frames(rows)), start=result.poses[rows])
    found = again.converged & denied[rows]
    moved = rows[found]
    poses, loads, residual_n = result.poses.copy(), result.loads.copy(), result.residual_n.copy()
    errors, on_model, reason = result.errors.copy(), result.on_model.copy(), result.reason.copy()
    poses[moved], loads[moved], residual_n[moved] = again.poses[found], again.loads[found], again.residual_n[found]
    errors[moved], on_model[moved] = again.errors[found], True
    for k in moved:
        said = (f"{part}: {verdict.words[k]}" for part, verdict in verdicts.items() if verdict.differs[k])
        reason[k] = f"on the contact models, for what they say of the foundations' pose ({', '.join(said)})"
    return replace(
        result,
        poses=poses,
        loads=loads,
        residual_n=residual_n,
        errors=errors,
        on_model=on_model,
        reason=reason,
        iterations=result.iterations + again.iterations,
        seconds=result.seconds + time.perf_counter() - began,
    )
