"""A cycle's poses with all that a command says of them: warnings about the cycle, a verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.verification.verdict import Verdict, judge, own_model
from casadi_contact.scenes.scene import Scene
from problems.common.learned_range import reasons
from problems.pose_estimation.centre_units import centre_warnings
from problems.pose_estimation.completion import solve_and_complete
from problems.pose_estimation.on_foundation import OnFoundation
from problems.pose_estimation.problem import Cycle, PoseEstimation, measured_pose, wanted_loads
from problems.pose_estimation.sign_warnings import sign_warnings
from problems.pose_estimation.solve import PoseResult, motion_of


@dataclass(frozen=True)
class Estimate:
    """The solution with a reason for every frame that is not verified, what the contact model says of it, and what it
    is on the elements of a scene that has some."""

    result: PoseResult
    verdict: Verdict
    ef: OnFoundation | None


def cycle_warnings(scene: Scene, cycle: Cycle) -> Iterator[str]:
    """Lines that ask about a cycle's units and signs, before any kernel is compiled for it: of sizes at once, of all
    else when the scene's surfaces are read.

    Raises ValueError as `wanted_loads` does.
    """
    wanted, measured = wanted_loads(scene, cycle), measured_pose(scene, cycle)
    model = own_model(scene)
    yield from centre_warnings(wanted, model)
    yield from sign_warnings(wanted, measured, model)


def estimated(problem: PoseEstimation, start: Array | None, model: ContactModel | str) -> Estimate:
    """A problem solved, completed and judged on the contact model, or the reason why there is none (`own_model`).

    start: poses (n, 6), `PoseEstimation.start_poses` if None.
    """
    result = solve_and_complete(problem, start, model)
    verdict = judge(problem.model, result.poses, result.converged, model, problem.wanted.load_names, result.on_model)
    verdict = replace(verdict, without_load=~problem.wanted.loaded)
    motion = motion_of(problem)
    if motion is not None:
        steps = motion.leaping(result.poses, result.converged & problem.wanted.loaded)
        verdict = replace(verdict, leaps=np.append(steps, False) | np.append(False, steps))
    ef = OnFoundation.of(problem, result)
    result = replace(result, reason=reasons(problem.model, result.poses, verdict, result.reason))
    return Estimate(result, verdict, ef)
