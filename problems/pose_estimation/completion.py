"""Frames that the surrogate leaves unsolved, on the contact model that it stands for: which of them have a pose.

infeasible                   the contact model settles from no start, or no contact has their centre of pressure
outside the learned range    the contact model has a pose there: the frame goes on with it, "on the contact model"
not found                    its pose lies inside the range: the surrogate is solved again from there

Frames that are solved on a foundation, where the contact model differs from it by more than a verified frame may, are
solved again from the contact model's pose, and go on with the contact model where it differs there too. Those of a
surrogate stay as they are: refining is their cure.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.verification.verdict import DIFFERS, judge
from casadi_contact.optimisation.verification.verify import loads_on
from problems.common.learned_range import beyond_learned
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.reach import beyond_reach_mm
from problems.pose_estimation.search import Found, search
from problems.pose_estimation.solve import PoseResult, frame_solver, solve, without_leaps
from problems.pose_estimation.wanted import COP_TOLERANCE_MM, off_by


def solve_and_complete(problem: PoseEstimation, start: Array | None, model: ContactModel | str) -> PoseResult:
    """`solve`, without leaps, and `complete`, on a foundation first with itself; where model is the reason why there
    is none (`own_model`), that is all there is."""
    if problem.learned and isinstance(model, str):
        return without_leaps(problem, solve(problem, start))
    result = without_leaps(problem, solve(problem, start, alone=False))
    if not problem.learned:
        result = complete(problem, result, problem.model)
    if isinstance(model, str):
        return result
    if not problem.learned:  # on it: on the foundation, which the elements have not seen yet
        none = np.zeros(problem.frames, dtype=bool)
        result = replace(result, on_model=none, on_rim=none)
    result = complete(problem, result, model)
    return result if problem.learned else _corrected(problem, result, model)


def complete(problem: PoseEstimation, result: PoseResult, model: ContactModel) -> PoseResult:
    """The result with every unsolved frame solved again, solved on the contact model, or said to be infeasible: so are
    frames that a surrogate solves by loads that no contact has, far outside of what it learned.

    With smoothness, which couples frames, the result stays as it is.
    """
    began = time.perf_counter()
    wanted = problem.wanted
    reach = beyond_reach_mm(model, wanted)
    result = _without_impossible(problem, result, model, reach > COP_TOLERANCE_MM)
    if problem.smoothness > 0.0 or result.converged.all():
        return result
    # Without load there is no centre of pressure to look for.
    left = ~result.converged & (reach <= COP_TOLERANCE_MM) & wanted.loaded
    found = _searched(problem, result, model, left)
    settled = left & found.found
    poses, loads, reason = result.poses.copy(), result.loads.copy(), result.reason.copy()
    loads[settled] = loads_on(model, found.poses[settled], wanted.load_names)
    on_it = wanted.errors(loads)
    on_model = settled & wanted.carried(on_it)
    poses[on_model] = found.poses[on_model]
    beyond = beyond_learned(problem.model, poses)
    again, iterations = _again(problem, poses, on_model & (beyond == ""))
    on_model &= ~again
    loads[~on_model] = problem.model(poses[~on_model], wanted.load_names)
    errors = wanted.errors(loads)
    on_rim = on_model & model.at_edge(poses).any(axis=1)
    for k in np.flatnonzero(~result.converged & wanted.loaded):
        if not left[k]:
            reason[k] = f"infeasible: {reach[k]:.3g} mm beyond any centre of pressure that contact can have"
        elif again[k]:
            reason[k] = "not found at first: solved from the pose of the contact model"
        elif on_model[k]:
            where = "carried on its rim" if on_rim[k] else "fits on the insert"
            why = beyond[k] or (
                "inside the learned range, where the surrogate has no such pose"
                if problem.learned
                else "the foundation has no such pose"
            )
            reason[k] = f"on the contact model, {where}: {why}"
        else:
            why = f"at the nearest {off_by(wanted.values, on_it[k])}" if settled[k] else found.reason[k]
            reason[k] = f"no equilibrium on the contact model, from {found.starts[k]} starts: {why}"
    return replace(
        result,
        poses=poses,
        loads=loads,
        errors=errors,
        converged=result.converged | again | on_model,
        on_model=on_model,
        on_rim=on_rim,
        reason=reason,
        iterations=result.iterations + iterations,
        seconds=result.seconds + time.perf_counter() - began,
    )


def _without_impossible(
    problem: PoseEstimation, result: PoseResult, model: ContactModel, beyond: np.ndarray
) -> PoseResult:
    """The result, frames wanted beyond (n,) any centre of pressure unsolved where the contact model differs."""
    if problem.smoothness > 0.0 or not (result.converged & beyond).any():
        return result
    verdict = judge(problem.model, result.poses, result.converged, model, problem.wanted.load_names)
    off = (np.abs(verdict.errors) > verdict.allowed).any(axis=1)  # on elements that are too coarse, too
    return replace(result, converged=result.converged & ~(beyond & off))


def _corrected(problem: PoseEstimation, result: PoseResult, model: ContactModel) -> PoseResult:
    """The result with the frames in which the contact model differs solved on it, from where they stand, and then on
    the foundation from there, which may have those loads in poses far apart. With smoothness, and where the contact
    model has no pose, frames stay."""
    began = time.perf_counter()
    names = problem.wanted.load_names
    verdict = judge(problem.model, result.poses, result.converged, model, names, result.on_model)
    if problem.smoothness > 0.0 or not verdict.differs.any():
        return result
    found = search(model, problem, result.poses, result.converged & ~verdict.differs, verdict.differs, None)
    moved = verdict.differs & found.found
    on_it = result.loads.copy()
    on_it[moved] = loads_on(model, found.poses[moved], names)
    moved &= problem.wanted.carried(problem.wanted.errors(on_it))
    poses = np.where(moved[:, None], found.poses, result.poses)
    again, iterations = _again(problem, poses, moved)
    if again.any():
        again[again] = ~judge(problem.model, poses[again], again[again], model, names).differs
    on_model = moved & ~again
    poses[on_model] = found.poses[on_model]
    loads, reason, on_rim = result.loads.copy(), result.reason.copy(), result.on_rim.copy()
    loads[again], loads[on_model] = problem.model(poses[again], names), on_it[on_model]
    if on_model.any():
        on_rim[on_model] = model.at_edge(poses[on_model]).any(axis=1)
    for k in np.flatnonzero(moved):
        off = verdict.words[k].removeprefix(f"{DIFFERS} by ")
        reason[k] = (
            f"found at first in another pose, where the contact model differs by {off}: solved from its pose"
            if again[k]
            else f"on the contact model: in the pose of the foundation it differs by {off}"
        )
    return replace(
        result,
        poses=poses,
        loads=loads,
        errors=problem.wanted.errors(loads),
        on_model=result.on_model | on_model,
        on_rim=on_rim,
        reason=reason,
        iterations=result.iterations + iterations,
        seconds=result.seconds + time.perf_counter() - began,
    )


def _searched(problem: PoseEstimation, result: PoseResult, model: ContactModel, left: np.ndarray) -> Found:
    """Poses on the contact model for the frames left (n,)."""
    middle = problem.start_poses()
    if not isinstance(model, ElasticFoundation):
        return search(model, problem, result.poses, result.converged, left, middle)
    # Grids differ little in where a pose lies, and much in time.
    coarse = ElasticFoundation(model.scene, model.scene.grids["settle"])
    near = search(coarse, problem, result.poses, result.converged, left, middle, roughly=True)
    fine = search(model, problem, near.poses, result.converged, left, None)
    return replace(fine, starts=near.starts + fine.starts)


def _again(problem: PoseEstimation, poses: Array, rows: np.ndarray) -> tuple[np.ndarray, int]:
    """Solve frames alone on the surrogate from their poses, changed in place where these carry what is wanted: which
    are solved, and iterations."""
    again, iterations = np.zeros(len(poses), dtype=bool), 0
    if not rows.any():
        return again, iterations
    frame, wanted, tried = frame_solver(problem), problem.parameters, poses.copy()
    starts = problem.contact.variables(poses).reshape(len(poses), -1)
    for k in np.flatnonzero(rows):
        answer, spent = frame.solve(starts[k], wanted[k])
        iterations += spent
        if answer is not None:
            tried[[k]], again[k] = problem.contact.moved(poses[[k]], answer), True
    again &= problem.wanted.carried(problem.wanted.errors(problem.model(tried, problem.wanted.load_names)))
    poses[again] = tried[again]
    return again, iterations
