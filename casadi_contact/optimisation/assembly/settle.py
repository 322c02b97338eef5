"""The poses at which an assembly is in equilibrium, by pseudo-transient continuation.

Bodies move through a viscous fluid, C·q̇ = Q(q) + applied, C = 1 N·s/mm (about 25 mm for rotations), in implicit Euler
steps (C/Δt - ∂Q/∂q)·Δq = Q that double as long as no pose moves farther than a bound: from far away they follow the
motion, so that they end in a stable equilibrium, and near it they become Newton's (Kelley and Keyes 1998).
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

_FIRST_STEP_S = 1e-4
_LARGEST_MOVE_MM = 0.5
_LONGEST_STEP_S = 1e12


@dataclass(frozen=True)
class SettledBodies:
    """Poses (bodies, 6); residual [N]: the largest force left along a free parameter, torques over 25 mm."""

    poses: Array
    residual: float
    converged: bool


class Settling:
    """Settles the free pose parameters of bodies (by name), again and again for other poses and tensions.

    Raises ValueError for bodies that the assembly has not, and unless some parameters are free, each named once.
    """

    def __init__(self, assembly: Assembly, free: Mapping[str, Sequence[str]]) -> None:
        _check_bodies(assembly, free)
        self.assembly, count = assembly, len(assembly.bodies)
        self.rows = [
            6 * assembly.bodies.index(body) + pose_index(name) for body, names in free.items() for name in names
        ]
        if not self.rows or len(set(self.rows)) < len(self.rows):
            said = "; ".join(f"{body}: {', '.join(names)}" for body, names in free.items()) or "nothing"
            raise ValueError(f"free is {said}, expected at least one pose parameter of a body, each named once")
        x, given, tensions = (
            ca.MX.sym("x", 6 * count),
            ca.MX.sym("given", 6 * count),
            ca.MX.sym("tensions", len(assembly.pulls)),
        )
        forces = ca.vec(assembly.forces()(ca.reshape(x, 6, count), tensions)) + given
        slopes = ca.jacobian(forces, x)[self.rows, self.rows]
        self._evaluate = ca.Function("settle", [x, given, tensions], [forces[self.rows], slopes])

    def __call__(
        self,
        poses: ArrayLike,
        applied: Mapping[str, ArrayLike] | None = None,
        tensions: Sequence[float] = (),
        *,
        tolerance: float = 1e-6,
        max_iterations: int = 1000,
    ) -> SettledBodies:
        """As `settle_assembly`."""
        assembly, rows = self.assembly, self.rows
        q, applied = as_poses(poses).copy(), applied or {}
        _check_bodies(assembly, applied)
        if len(q) != len(assembly.bodies):
            raise ValueError(
                f"got {len(q)} poses; assembly {assembly.name} has the free bodies {', '.join(assembly.bodies)}"
            )
        pulls = ", ".join(pull.name for pull in assembly.pulls) or "none"
        pulling = finite_vector(
            "tensions are", tensions, len(assembly.pulls), f"a finite number [N] for each pull ({pulls})"
        )
        if (pulling < 0.0).any():
            raise ValueError(f"tensions are {list(tensions)} N, expected 0 or more: a line pulls and never pushes")
        given = np.zeros(6 * len(q))
        for body, force in applied.items():
            forces = finite_vector(
                f"forces on {body} are", force, 6, "6 finite numbers: Fx ... Fz [N], Tx ... Tz [N·mm]"
            )
            given[6 * assembly.bodies.index(body) :][:6] = forces
        in_mm = np.tile(POSE_IN_MM, len(q))[rows]
        step, position = _FIRST_STEP_S, q.ravel()
        for iteration in itertools.count():
            left, slope = (np.asarray(part) for part in self._evaluate(position, given, pulling))
            residual = float(np.abs(left.ravel() / in_mm).max())
            if residual <= tolerance or not np.isfinite(residual) or iteration >= max_iterations:
                break
            while True:
                move = np.linalg.solve(np.diag(in_mm**2 / step) - slope, left.ravel())
                if np.abs(move * in_mm).max() <= _LARGEST_MOVE_MM or step < 1e-12:
                    break
                step *= 0.5
            position[rows] += move
            step = min(2.0 * step, _LONGEST_STEP_S)
        return SettledBodies(position.reshape(-1, 6), residual, residual <= tolerance)


def _check_bodies(assembly: Assembly, named: Mapping[str, object]) -> None:
    unknown = set(named) - set(assembly.bodies)
    if unknown:
        known = ", ".join(assembly.bodies)
        raise ValueError(f"got the bodies {', '.join(named)}; assembly {assembly.name} has the free bodies {known}")


def settle_assembly(
    assembly: Assembly,
    poses: ArrayLike,
    free: Mapping[str, Sequence[str]],
    applied: Mapping[str, ArrayLike] | None = None,
    tensions: Sequence[float] = (),
    *,
    tolerance: float = 1e-6,
    max_iterations: int = 1000,
) -> SettledBodies:
    """Move the free pose parameters of bodies (by name) until what acts on them vanishes.

    poses (bodies, 6): start, and the values of locked parameters; applied: further generalised forces (6,) [N, N·mm] by
    body; tensions [N] of the pulls; max_iterations: steps at most, none where 0. Raises ValueError for unknown names,
    where nothing is free and for wrong numbers; what does not converge is reported, not raised.
    """
    check_above_zero(tolerance=tolerance)
    settle = Settling(assembly, free)
    return settle(poses, applied, tensions, tolerance=tolerance, max_iterations=max_iterations)
