"""Settling by a damped Newton method, all poses at once ([EF15 §2.4], "via optimization")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from casadi_contact.contact.equilibrium import Equilibrium, start_copy
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, Progress, check_above_zero
from casadi_contact.core.quantities import quantity, three_digits

NOT_FINITE = "the contact model's loads are not finite"


@dataclass(frozen=True)
class SettleReport:
    """What became of each pose: converged (n,), iterations (n,), residual (n,) [N, torques over 25 mm], reason (n,).

    misfit holds load minus target load by name, each (n,) [N, N·mm]; reason is "" where converged.
    """

    converged: np.ndarray
    iterations: np.ndarray
    residual: Array
    misfit: Mapping[str, Array]
    reason: np.ndarray

    def __str__(self) -> str:
        return (
            f"{int(self.converged.sum())} of {len(self.converged)} poses converged, "
            f"median {np.median(self.iterations):g} iterations, largest residual {three_digits(self.residual.max())} N"
            if len(self.converged)
            else "no poses"
        )


def settle(
    model: ContactModel,
    poses: ArrayLike,
    free: Sequence[str],
    targets: Mapping[str, ArrayLike],
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 60,
    trust_region: bool = True,
    progress: Progress | None = None,
) -> tuple[Array, SettleReport]:
    """Vary the free pose parameters of each pose until the model carries the target loads.

    Levenberg-Marquardt on `Equilibrium`'s residuals with the model's own Jacobian: with as many targets as free
    parameters a damped Newton method; with more, or where no pose carries the loads, it ends at the nearest pose in
    the least-squares sense and says so. tolerance is in N (torques over 25 mm). Where more than the scene's sensitive
    pose parameters is free, these settle first under the normal loads alone: torques of bodies that press each other
    far too hard, or one side alone, lead astray. What then stands still short of the loads, where torques of a mesh
    rise and fall within tenths of a millimetre, goes on by a trust region (SciPy's ``least_squares``), from there and
    from a few places up to 0.3 mm around it, one pose after the other: trust_region=False leaves it, where better
    starts are at hand.

    What the scene locks or ties is put in place at the start, and tied parameters follow the free ones in every step:
    all poses lie in the scene's pose space. progress(done, all) is called in every step: poses settled, or given up.

    Returns the poses (n, 6) and a `SettleReport`. Raises ValueError for bad poses, names or targets, a tolerance that
    is not above 0, and for a free parameter that the scene locks or ties; a pose that does not converge is reported,
    not raised.
    """
    check_above_zero(tolerance=tolerance)
    poses = start_copy(model, poses)
    count = len(poses)
    equations = Equilibrium.of(model, count, free, targets)
    if count == 0:
        empty = np.zeros(0)
        misfits = dict.fromkeys(equations.names, empty)
        return poses, SettleReport(empty.astype(bool), empty.astype(int), empty, misfits, np.array([], dtype=object))
    pressing, pressed = equations.pressing(), np.zeros(count, dtype=int)
    if pressing is not None:
        poses, _, pressed, _ = _newton_with_restarts(pressing, poses, tolerance, max_iterations, progress)
    poses, misfit, iterations, stalled = _newton_with_restarts(equations, poses, tolerance, max_iterations, progress)
    if pressing is not None and trust_region:
        short = stalled & ~equations.pulls() & (equations.in_newtons(misfit) > tolerance)
        for row in map(int, np.flatnonzero(short)):
            iterations[row] += _trust_region(equations, row, poses, misfit, tolerance, max_iterations)
    residual = equations.in_newtons(misfit)
    converged = residual <= tolerance
    reason = _reasons(equations, converged, stalled, misfit)
    misfits = {name: misfit[:, column] for column, name in enumerate(equations.names)}
    return poses, SettleReport(converged, pressed + iterations, residual, misfits, reason)


def _newton_with_restarts(
    equations: Equilibrium,
    poses: Array,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None,
    restarts: int = 3,
    reach_mm: float = 30.0,
) -> tuple[Array, Array, np.ndarray, np.ndarray]:
    """What `_newton` gives; a body that stalls without contact, between the walls of a cup or beside it, begins again
    from where it presses on its way along the target force."""
    start = poses
    poses, misfit, iterations, stalled = _newton(equations, start, tolerance, max_iterations, progress)
    for number in range(restarts):
        missing = stalled & equations.misses_a_force(misfit) & (equations.in_newtons(misfit) > tolerance)
        rows = np.flatnonzero(missing & ~equations.pulls())
        if not len(rows):
            break
        lost = equations.of_rows(rows)
        again = _newton(
            lost, lost.along_the_force(start[rows], np.arange(0.0, reach_mm, 0.25), number), tolerance, max_iterations
        )
        better = lost.in_newtons(again[1]) < lost.in_newtons(misfit[rows])
        iterations[rows] += again[2]
        for before, found in ((poses, again[0]), (misfit, again[1]), (stalled, again[3])):
            before[rows[better]] = found[better]
    return poses, misfit, iterations, stalled


def _newton(
    equations: Equilibrium,
    poses: Array,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None = None,
    *,
    step_limit_mm: float = 2.0,
    smallest_step_mm: float = 1e-12,
    smallest_fraction: float = 1e-6,
) -> tuple[Array, Array, np.ndarray, np.ndarray]:
    """Poses (n, 6), their misfits (n, targets), iterations (n,), and which stalled (n,), from a start that is kept."""
    poses, count = poses.copy(), len(poses)
    r, jacobian, misfit = equations.residuals(poses, np.arange(count))
    fraction = np.ones(count)
    iterations = np.zeros(count, dtype=int)
    stalled = np.zeros(count, dtype=bool)
    for _ in range(max_iterations):
        rows = np.flatnonzero((equations.in_newtons(misfit) > tolerance) & ~stalled)
        if progress is not None:
            progress(count - len(rows), count)
        if not len(rows):
            break
        inverse = _damped_inverse(jacobian[rows])
        newton = -np.einsum("nit,nt->ni", inverse, r[rows])
        length = np.abs(newton).max(axis=1)
        reach = np.minimum(fraction[rows], step_limit_mm / np.maximum(length, 1e-300))
        trial = equations.moved(poses[rows], reach[:, None] * newton)
        r_new, jacobian_new, misfit_new = equations.residuals(trial, rows)
        # Natural monotonicity: the step that is left, measured with the old Jacobian, must shrink. Unlike a sum of
        # squares this does not depend on how the residuals are scaled against one another.
        left = np.abs(np.einsum("nit,nt->ni", inverse, r_new)).max(axis=1)
        better = left <= (1.0 - 0.25 * reach) * length
        kept = rows[better]
        poses[kept], r[kept], jacobian[kept], misfit[kept] = (
            a[better] for a in (trial, r_new, jacobian_new, misfit_new)
        )
        iterations[rows] += 1
        fraction[rows] = np.where(better, np.minimum(1.0, 2.0 * fraction[rows]), 0.35 * reach)
        # Nothing left to gain: a local least-squares solution, or the limit of arithmetic.
        stalled[rows] = (fraction[rows] < smallest_fraction) | (length < smallest_step_mm)
    return poses, misfit, iterations, stalled


def _trust_region(
    equations: Equilibrium,
    row: int,
    poses: Array,
    misfit: Array,
    tolerance: float,
    max_iterations: int,
    *,
    shakes_tried: int = 6,
    shaken_mm: float = 0.3,
    least_gain: float = 1e-6,
) -> int:
    """Go on with one row in a trust region, from its pose and about it, until it carries the loads. Its pose and misfit
    are replaced where they come nearer. Returns the steps taken."""
    size, rows, start = len(equations.free), np.array([row]), poses[[row]]
    shakes = np.random.default_rng(0).uniform(-shaken_mm, shaken_mm, (shakes_tried, size))

    known: dict[bytes, tuple[Array, Array, Array]] = {}

    def residuals(steps: Array) -> tuple[Array, Array, Array]:
        """Kept for the Jacobian, which SciPy asks for where it has asked for the value. Not a number for steps that are
        none, which SciPy may take where Jacobians are all but singular: it then keeps where it was."""
        if not np.isfinite(steps).all():
            nothing = np.full((1, len(equations.names)), np.nan)
            return nothing, np.full((1, len(equations.names), size), np.nan), nothing
        if steps.tobytes() not in known:
            known.clear()
            known[steps.tobytes()] = equations.residuals(equations.moved(start, steps), rows)
        return known[steps.tobytes()]

    taken = 0
    for begun in (np.zeros(size), *shakes):
        if not np.isfinite(residuals(begun)[0]).all():
            continue
        with np.errstate(divide="ignore", invalid="ignore"):  # SciPy divides by a step of length zero
            found = least_squares(
                lambda steps: residuals(steps)[0][0],
                begun,
                lambda steps: residuals(steps)[1][0],
                xtol=least_gain,
                ftol=least_gain,
                gtol=None,
                max_nfev=max_iterations,
            )
        taken += int(found.nfev)
        left = residuals(found.x)[2]
        if equations.in_newtons(left)[0] < equations.in_newtons(misfit[rows])[0]:
            poses[row], misfit[row] = equations.moved(start, found.x)[0], left[0]
        if equations.in_newtons(misfit[rows])[0] <= tolerance:
            break
    return taken


def _damped_inverse(jacobian: Array, damping: float = 1e-11) -> Array:
    """(JᵀJ + μ·I)⁻¹ Jᵀ of every row, μ just large enough for a singular J (two patches off, say)."""
    normal = np.einsum("nti,ntj->nij", jacobian, jacobian)
    size = np.einsum("nii->n", normal) + 1e-12
    normal += (damping * size)[:, None, None] * np.eye(normal.shape[1])
    return np.linalg.solve(normal, np.swapaxes(jacobian, 1, 2))


def _reasons(equations: Equilibrium, converged: np.ndarray, stalled: np.ndarray, misfit: Array) -> np.ndarray:
    pulls = equations.pulls()
    reasons = np.full(len(converged), "", dtype=object)
    for row in np.flatnonzero(~converged):
        if not np.isfinite(misfit[row]).all():
            reasons[row] = NOT_FINITE
            continue
        worst = int(equations.each_in_newtons(misfit[row]).argmax())
        name = equations.names[worst]
        left = f"{name} is off by {misfit[row, worst]:.4g} {quantity(name).unit}"
        if pulls[row]:
            reasons[row] = f"no equilibrium: a target load pulls, contact only pushes; {left}"
        elif stalled[row]:
            reasons[row] = f"no equilibrium near this start: at the nearest pose found {left}"
        else:
            reasons[row] = f"iterations used up: {left}"
    return reasons
