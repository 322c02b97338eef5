"""What is unbalanced in a row's pose on a contact model, how it answers to the pose, and what nothing holds."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.joint_mechanics import wrench_function
from casadi_contact.optimisation.starts import KNEE_STEPS
from problems.static_equilibrium.problem import StaticEquilibrium, residual_function

HELD = 1e-6  # share of the stiffest direction's stiffness below which one counts as held by nothing


@dataclass(frozen=True)
class Balance:
    """Of a problem's rows on a contact model: functions of scaled free parameters q (f,), loads (6,) and rest pose (6,)
    that give r/L (f,) [N] and its slope by q (f, f)."""

    problem: StaticEquilibrium
    residual: ca.Function
    slope: ca.Function

    @classmethod
    def of(cls, problem: StaticEquilibrium, model: ContactModel) -> Balance:
        """On the problem's own model or another one of its scene."""
        contact, space = wrench_function(model), problem.model.scene.pose_space
        residual = residual_function(contact, problem.free, problem.about, problem.stiffness, space)
        given = [ca.MX.sym(name, size) for name, size in (("q", len(problem.free)), ("loads", 6), ("rest", 6))]
        return cls(problem, residual, ca.Function("slope", given, [ca.jacobian(residual(*given), given[0])]))

    def unbalanced_n(self, row: int, q: Array) -> Array:
        """r/L (f,) [N] of a row."""
        return np.asarray(self.residual(q, self.problem.loads[row], self.problem.rest[row])).ravel()

    def slopes(self, row: int, q: Array) -> Array:
        """Its derivatives by q (f, f)."""
        return np.asarray(self.slope(q, self.problem.loads[row], self.problem.rest[row]))

    def loose(self, row: int, pose: Array) -> list[str]:
        """The free parameters along which something is left over in a pose (6,) in contact that no move of it changes:
        a ball's torque about its centre. None where a patch presses along one of them: loads that are clamped to zero
        do not change out of contact, but there are poses that hold it."""
        problem = self.problem
        if not problem.model(pose[None]).any():
            return []
        q = problem.variables(pose)
        ways, stiffnesses, _ = np.linalg.svd(self.slopes(row, q))
        fixed = ways[:, stiffnesses <= HELD * stiffnesses[0]]
        left = fixed @ (fixed.T @ self.unbalanced_n(row, q))
        names = [name for name, off in zip(problem.free, left, strict=True) if abs(off) > problem.tolerance_n[row]]
        return [] if set(names) & set(problem.model.scene.sensitive_pose) else names

    def held_moves(self, poses: Array, moves: Array) -> Array:
        """Of moves (n, 6) away from poses (n, 6) of all rows the part that contact or springs hold: a ball may turn in
        its cup."""
        problem, held = self.problem, np.zeros_like(moves)
        for row, (q, move) in enumerate(zip(problem.variables(poses), problem.variables(moves), strict=True)):
            stiffness = self.slopes(row, q)
            answer = np.linalg.lstsq(stiffness, stiffness @ move, rcond=HELD)[0]
            held[row, problem.columns] = answer * KNEE_STEPS[problem.columns]
        return held
