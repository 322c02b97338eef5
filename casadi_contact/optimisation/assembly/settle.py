"""The poses at which an assembly is in equilibrium, by pseudo-transient continuation.

Bodies move through a viscous fluid, C·q̇ = Q(q) + applied, with C = 1 N·s/mm (25² N·mm·s for rotations). Implicit Euler
steps, (C/Δt - ∂Q/∂q)·Δq = Q + applied, double Δt unless a pose would move farther than a bound. Small steps follow the
motion into a stable equilibrium. Large steps are Newton's (Kelley and Keyes 1998).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import POSE_IN_MM, Array, as_poses, check_above_zero, pose_index
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import finite_vector


@dataclass(frozen=True)
class SettledBodies:
    """Poses (bodies, 6); residual [N]: the largest force left along a free parameter, torques over 25 mm."""

    poses: Array
    residual: float
    converged: bool


class Settling:
    """Equilibrium of the free pose parameters of bodies (by name), for any poses, forces and tensions.

    first_step_s: of the continuation; largest_move_mm: bound of one step, turns at 25 mm. Raises ValueError for bodies
    that the assembly has not, and unless some parameters are free, each named once.
    """

    def __init__(
        self,
        assembly: Assembly,
        free: Mapping[str, Sequence[str]],
        *,
        first_step_s: float = 1e-4,
        largest_move_mm: float = 0.5,
    ) -> None:
        self.assembly, self.first_step_s, self.largest_move_mm = assembly, first_step_s, largest_move_mm
        self.rows = [6 * self._body(body) + pose_index(name) for body, names in free.items() for name in names]
        if not self.rows or len(set(self.rows)) < len(self.rows):
            raise ValueError(f"free is {dict(free)}, expected pose parameters of bodies, each named once")
        size = 6 * len(assembly.bodies)
        x, applied, tensions = (
            ca.MX.sym(name, count)
            for name, count in (("x", size), ("applied", size), ("tensions", len(assembly.pulls)))
        )
        forces = ca.vec(assembly.forces()(ca.reshape(x, 6, len(assembly.bodies)), tensions)) + applied
        jacobian = ca.jacobian(forces, x)[self.rows, self.rows]
        self._evaluate = ca.Function("settle", [x, applied, tensions], [forces[self.rows], jacobian])

    def __call__(
        self,
        poses: ArrayLike,
        applied: Mapping[str, ArrayLike] | None = None,
        tensions: Sequence[float] = (),
        *,
        tolerance: float = 1e-6,
        max_iterations: int = 1000,
    ) -> SettledBodies:
        """Settle from poses (bodies, 6), which hold the values of locked parameters too.

        applied: further generalised forces (6,) [N, N·mm] by body; tensions [N] of the pulls. Raises ValueError for
        wrong numbers; what does not converge is reported, not raised.
        """
        check_above_zero(tolerance=tolerance)
        assembly, rows = self.assembly, self.rows
        position = as_poses(poses).ravel().copy()
        if len(position) != 6 * len(assembly.bodies):
            raise ValueError(f"got {len(position) // 6} poses, expected those of {', '.join(assembly.bodies)}")
        pulls = ", ".join(pull.name for pull in assembly.pulls) or "none"
        expected = f"a finite number [N] for each pull ({pulls})"
        pulling = finite_vector("tensions are", tensions, len(assembly.pulls), expected)
        if (pulling < 0.0).any():
            raise ValueError(f"tensions are {list(tensions)} N, expected 0 or more: a line pulls and never pushes")
        given = np.zeros(len(position))
        for body, force in (applied or {}).items():
            given[6 * self._body(body) :][:6] = finite_vector(f"forces on {body} are", force, 6)
        in_mm = np.tile(POSE_IN_MM, len(assembly.bodies))[rows]
        step = self.first_step_s
        for iteration in itertools.count():
            left, jacobian = (np.asarray(part) for part in self._evaluate(position, given, pulling))
            residual = float(np.abs(left.ravel() / in_mm).max())
            if residual <= tolerance or not np.isfinite(residual) or iteration >= max_iterations:
                break
            while True:
                move = np.linalg.solve(np.diag(in_mm**2 / step) - jacobian, left.ravel())
                if np.abs(move * in_mm).max() <= self.largest_move_mm or step < 1e-12:
                    break
                step *= 0.5
            position[rows] += move
            step = min(2.0 * step, 1e12)
        return SettledBodies(position.reshape(-1, 6), residual, residual <= tolerance)

    def _body(self, name: str) -> int:
        bodies = self.assembly.bodies
        if name not in bodies:
            raise ValueError(f"got the body {name}, assembly {self.assembly.name} has {', '.join(bodies)}")
        return bodies.index(name)
