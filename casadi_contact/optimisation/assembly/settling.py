"""Rest under given loads, by pseudo-transient continuation, of bodies' poses and of coordinates of joints.

Bodies move through a viscous fluid, C·q̇ = Q(q), with C = 1 N·s/mm (25² N·mm·s for rotations). Implicit Euler steps,
(C/Δt - ∂Q/∂q)·Δq = Q, double Δt unless something would move farther than 0.5 mm (a turn counts at 25 mm). Small steps
follow the motion into a stable equilibrium. Large steps are Newton's (Kelley and Keyes 1998).
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array, check_above_zero
from casadi_contact.optimisation.assembly.assembly import Assembly


def pseudo_transient(
    evaluate: Callable[[Array], tuple[Array, Array]],
    position: Array,
    rows: Sequence[int],
    in_mm: Array,
    tolerance: float,
    max_iterations: int,
) -> tuple[Array, float]:
    """Position (n,) in which the entries of `rows` are at rest, and the residual [N] left. evaluate: their forces (r,)
    and derivatives (r, r); in_mm (r,): mm in a unit of each, so that a force over it is in N."""
    position, step = position.copy(), 1e-4  # s
    for iteration in itertools.count():
        left, jacobian = evaluate(position)
        residual = float(np.abs(left / in_mm).max())
        if residual <= tolerance or not np.isfinite(residual) or iteration >= max_iterations:
            return position, residual
        while True:
            move = np.linalg.solve(np.diag(in_mm**2 / step) - jacobian, left)
            if np.abs(move * in_mm).max() <= 0.5 or step < 1e-12:
                break
            step *= 0.5
        position[rows] += move
        step = min(2.0 * step, 1e12)
    raise AssertionError


@dataclass(frozen=True)
class SettledCoordinates:
    """q (n) [m, rad]; residual [N]: the largest force left along a free coordinate, moments over 25 mm."""

    q: Array
    residual: float
    converged: bool


class CoordinateSettling:
    """Rest of some coordinates of an assembly, by name; all others are held. by_force: muscles have given forces [N] in
    place of activations. Raises ValueError for coordinates that are not there, and for none."""

    def __init__(self, assembly: Assembly, free: Sequence[str], *, by_force: bool = False) -> None:
        self.rows = assembly.rows(free)
        if not self.rows or len(set(self.rows)) < len(self.rows):
            raise ValueError(f"free is {', '.join(free) or 'empty'}, expected coordinates, each named once")
        self._in_mm = np.array([assembly.coordinate_table[name].in_mm for name in free])
        sizes = {"x": len(free), "q": len(assembly.coordinates), "drive": len(assembly.muscles), "applied": len(free)}
        x, given, drive, applied = (ca.MX.sym(key, size) for key, size in sizes.items())
        q = ca.MX(given)
        q[self.rows] = x
        found = assembly.function(name="settling", coordinates=free, by_force=by_force)(q, 0.0, 0.0, drive)
        forces = 1e3 * (found + applied)  # N·mm in a unit
        self._evaluate = ca.Function("settle", [x, given, drive, applied], [forces, ca.jacobian(forces, x)])

    def __call__(
        self,
        q: ArrayLike,
        drive: ArrayLike = 0.0,
        applied: ArrayLike = 0.0,
        *,
        tolerance: float = 1e-4,
        max_iterations: int = 300,
    ) -> SettledCoordinates:
        """Settle from q (n) [m, rad] with activations or forces of muscles (m), or one for all, and further generalised
        forces applied (n) [N, N·m]. What does not converge is reported, not raised."""
        check_above_zero(tolerance=tolerance)

        def evaluate(position: Array) -> tuple[Array, Array]:
            forces, jacobian = self._evaluate(position[self.rows], position, np.asarray(drive), given)
            return forces.full().ravel(), jacobian.full()

        start = np.asarray(q, dtype=float).ravel()
        given = np.broadcast_to(np.asarray(applied, dtype=float), start.shape)[self.rows]
        found, residual = pseudo_transient(evaluate, start, self.rows, self._in_mm, tolerance, max_iterations)
        return SettledCoordinates(found, residual, residual <= tolerance)
