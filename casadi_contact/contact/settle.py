"""Static analyses: free pose parameters that carry target loads, by damped Newton steps of all poses ([EF15 §2.4])."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from casadi_contact.contact.model import ContactModel, root_vector, total_root, with_loads
from casadi_contact.core.conventions import LEVER_MM, Array, Progress, as_poses, check_above_zero, pose_index
from casadi_contact.core.quantities import quantity, three_digits

NOT_FINITE = "the contact model's loads are not finite"


@dataclass(frozen=True)
class Equilibrium:
    """Wanted loads (n, targets) of a contact model, to be met by varying the free pose parameters.

    A patch's normal load that is one load is compared as a signed root load, r = s - √(N*/N0), which is nearly
    linear in the pose and keeps its slope out of contact; the magnitude of three target forces as a root vector,
    r = s·u - √(N*/N0)·u*, with u the direction of the force (out of contact, that in which the body closes the gap);
    the total of normal loads along one direction by S = √(Σ max(s, 0)²) of all patches, out of contact s of the
    nearest. Any other load as r = (load - target)/N0 (torques over N0·LEVER_MM).
    """

    model: ContactModel
    free: tuple[int, ...]
    names: tuple[str, ...]
    target: Array

    @classmethod
    def of(cls, model: ContactModel, count: int, free: Sequence[str], targets: Mapping[str, ArrayLike]) -> Equilibrium:
        """Raises ValueError like `settle`."""
        if not free or len(set(free)) != len(free):
            raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
        model.scene.pose_space.check_free(free)
        if not targets:
            raise ValueError("targets is empty, expected target loads by name, for example {'Fy_med': -700.0}")
        model = with_loads(model, tuple(targets))
        target = np.empty((count, len(targets)))
        for column, (name, value) in enumerate(targets.items()):
            array = np.asarray(value, dtype=float)
            if array.shape not in ((), (1,), (count,)):
                raise ValueError(f"target {name} has shape {array.shape}, expected a number or ({count},)")
            if not np.isfinite(array).all():
                raise ValueError(f"target {name} holds NaN or infinity, expected finite loads")
            target[:, column] = array
        return cls(model, tuple(pose_index(name) for name in free), tuple(targets), target)

    @property
    def _normal_targets(self) -> dict[int, list[int]]:
        """Patches of each target (by column) that is the normal load of one, or their total along one direction."""
        normals = self.model.scene.normal_loads
        patches = {load.loads[0]: [p] for p, load in enumerate(normals) if load.component is not None}
        if len({(load.component, load.sign) for load in normals}) == 1:
            patches.setdefault(str(normals[0].component), list(range(len(normals))))
        return {column: patches[name] for column, name in enumerate(self.names) if name in patches}

    @property
    def _vector_targets(self) -> dict[int, list[int]]:
        """Columns of the three targets whose magnitude is a patch's normal load, by patch."""
        magnitudes = ((p, load.loads) for p, load in enumerate(self.model.scene.normal_loads) if load.component is None)
        return {p: list(map(self.names.index, loads)) for p, loads in magnitudes if set(loads) <= set(self.names)}

    def pressing(self) -> Equilibrium | None:
        """The equations of the sensitive pose parameters under the normal loads; None unless free, a load for each."""
        sensitive = tuple(pose_index(name) for name in self.model.scene.sensitive_pose)
        of_vectors = [column for columns in self._vector_targets.values() for column in columns]
        columns = sorted({*self._normal_targets, *of_vectors})
        if not columns or len(columns) != len(sensitive) or not set(sensitive) < set(self.free):
            return None
        return Equilibrium(self.model, sensitive, tuple(self.names[k] for k in columns), self.target[:, columns])

    def misses_a_force(self, misfit: Array, share: float = 0.01) -> np.ndarray:
        """True (n,) where a free body carries less than a share of a target force without a direction of its own."""
        missing = np.zeros(len(misfit), dtype=bool)
        for columns in self._vector_targets.values() if {0, 1, 2} <= set(self.free) else ():
            force = self.target[:, columns]
            missing |= np.linalg.norm(misfit[:, columns] + force, axis=1) < share * np.linalg.norm(force, axis=1)
        return missing

    def along_the_force(self, poses: Array, number: int, reach_mm: float = 30.0) -> Array:
        """Poses (n, 6) moved along the force that a patch shall carry, by the way about which residuals are least
        (number 0), next to least (1), ...: there are several where the body passes a rim before it presses."""
        force, ways_mm = self.target[:, next(iter(self._vector_targets.values()))], np.arange(0.0, reach_mm, 0.25)
        along = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
        moved = np.repeat(poses[:, None], len(ways_mm), axis=1)
        moved[:, :, :3] += ways_mm[:, None] * along[:, None]
        moved, rows = self.model.scene.pose_space.project(moved), np.repeat(np.arange(len(poses)), len(ways_mm))
        left = np.linalg.norm(self.residuals(moved.reshape(-1, 6), rows)[0], axis=1).reshape(moved.shape[:2])
        beside = np.pad(left, ((0, 0), (1, 1)), constant_values=np.inf)
        least = (left <= beside[:, :-2]) & (left <= beside[:, 2:])
        order = np.argsort(np.where(least, left, np.inf), axis=1, kind="stable")
        return np.asarray(moved[np.arange(len(poses)), order[:, number]])

    def pulls(self) -> np.ndarray:
        """True (n,) where a target normal load would pull, which no contact can."""
        pulling = np.zeros(len(self.target), dtype=bool)
        for column, patches in self._normal_targets.items():
            pulling |= self.model.scene.normal_loads[patches[0]].sign * self.target[:, column] < 0.0
        return pulling

    def reason(self, row: int, misfit: Array, stalled: bool) -> str:
        """Why a row with misfits (targets,) has not converged."""
        if not np.isfinite(misfit).all():
            return NOT_FINITE
        why = "no equilibrium near this start: at the nearest pose found" if stalled else "iterations used up:"
        if self.pulls()[row]:
            why = "no equilibrium: a target load pulls, contact only pushes;"
        worst = int(np.abs(misfit / self.load_scales).argmax())
        return f"{why} {self.names[worst]} is off by {misfit[worst]:.4g} {quantity(self.names[worst]).unit}"

    def misfit(self, loads: Array, rows: np.ndarray) -> Array:
        """Named loads minus target loads (rows, targets) [N, N·mm]."""
        columns = [self.model.load_names.index(name) for name in self.names]
        return loads[:, columns] - self.target[rows]

    def in_newtons(self, misfit: Array) -> Array:
        """Largest misfit of each row (rows,) [N], torques over LEVER_MM."""
        return np.asarray(np.abs(misfit / self.load_scales).max(axis=1))

    def residuals(self, poses: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
        """r (rows, targets), dr/dfree (rows, targets, free) in comparable mm, and the misfit [N, N·mm]; NaN all three
        where the model gives no finite loads, or none within a difference's step of them."""
        model, n0 = self.model, self.model.scene.reference_load
        normals, vectors = self._normal_targets, self._vector_targets
        if normals or vectors:
            loads, jacobian, *roots = model.jacobian_and_roots(poses)
        else:
            loads, jacobian = model.jacobian(poses)
        misfit = self.misfit(loads, rows)
        r, gradient = np.empty_like(misfit), np.empty((*misfit.shape, 6))
        for column, (name, scale) in enumerate(zip(self.names, n0 * self.load_scales, strict=True)):
            r[:, column] = misfit[:, column] / scale
            gradient[:, column] = jacobian[:, model.load_names.index(name)] / scale
        for column, patches in normals.items():
            target = model.scene.normal_loads[patches[0]].sign * self.target[rows, column]
            total, gradient[:, column] = total_root(*(of[:, patches] for of in roots))
            r[:, column] = total - np.sqrt(np.maximum(target, 0.0) / n0)
        for patch, columns in vectors.items():
            target = self.target[rows][:, columns]
            size = np.linalg.norm(target, axis=1, keepdims=True)
            of_loads, (s, ds) = [model.load_names.index(self.names[k]) for k in columns], (of[:, patch] for of in roots)
            vector, gradient[:, columns] = root_vector(loads[:, of_loads], jacobian[:, of_loads], s, ds, n0)
            r[:, columns] = vector - target / np.sqrt(n0 * np.where(size > 0.0, size, 1.0))
        gradient = self.model.scene.pose_space.pull_back(gradient)[..., list(self.free)] * self.free_scales
        lost = ~np.isfinite(gradient).all(axis=(1, 2)) | ~np.isfinite(r).all(axis=1)
        r[lost], gradient[lost], misfit[lost] = np.nan, np.nan, np.nan
        return r, gradient, misfit

    def moved(self, poses: Array, steps: Array) -> Array:
        """Poses (n, 6) after comparable steps (n, free) of the free parameters, what is tied to them following."""
        moved = poses.copy()
        moved[:, list(self.free)] += steps * self.free_scales
        return self.model.scene.pose_space.project(moved)

    @property
    def load_scales(self) -> Array:
        """What target loads are divided by to be compared in N: 1 for a force, LEVER_MM for a torque."""
        return np.array([LEVER_MM if name.startswith("T") else 1.0 for name in self.names])

    @property
    def free_scales(self) -> Array:
        """Size of one comparable step of each free parameter: 1 mm, or 1/LEVER_MM rad."""
        return np.array([1.0 if i < 3 else 1.0 / LEVER_MM for i in self.free])


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
        largest = three_digits(self.residual.max(initial=0.0))
        return f"{self.converged.sum()} of {len(self.converged)} poses converged, largest residual {largest} N"


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
    far too hard lead astray. What then stands still short of the loads goes on by a trust region (SciPy's
    ``least_squares``), from there and up to 0.3 mm around, one pose after the other; not with trust_region=False.

    What the scene locks or ties is put in place. progress(done, all): poses settled, or given up.

    Returns the poses (n, 6) and a `SettleReport`, which also says what did not converge. Raises ValueError for bad
    poses, names or targets, a tolerance that is not above 0, and a free parameter that the scene locks or ties.
    """
    check_above_zero(tolerance=tolerance)
    poses = model.scene.pose_space.project(as_poses(poses).copy())
    equations = Equilibrium.of(model, len(poses), free, targets)
    pressing, pressed = equations.pressing(), np.zeros(len(poses), dtype=int)
    if pressing is not None:
        poses, _, pressed, _ = _newton_with_restarts(pressing, poses, tolerance, max_iterations, progress)
    poses, misfit, iterations, stalled = _newton_with_restarts(equations, poses, tolerance, max_iterations, progress)
    if pressing is not None and trust_region:
        short = stalled & ~equations.pulls() & (equations.in_newtons(misfit) > tolerance)
        for row in map(int, np.flatnonzero(short)):
            iterations[row] += _trust_region(equations, row, poses, misfit, tolerance, max_iterations)
    residual, reason = equations.in_newtons(misfit), np.full(len(poses), "", dtype=object)
    for row in map(int, np.flatnonzero(~(residual <= tolerance))):
        reason[row] = equations.reason(row, misfit[row], stalled[row])
    misfits = dict(zip(equations.names, misfit.T, strict=True))
    return poses, SettleReport(residual <= tolerance, pressed + iterations, residual, misfits, reason)


def _newton_with_restarts(
    equations: Equilibrium, start: Array, tolerance: float, max_iterations: int, progress: Progress | None
) -> tuple[Array, Array, np.ndarray, np.ndarray]:
    """What `_newton` gives; a body that stalls without contact begins again from where the target force presses it."""
    poses, misfit, iterations, stalled = _newton(equations, start, tolerance, max_iterations, progress)
    for number in range(3):
        missing = stalled & equations.misses_a_force(misfit) & (equations.in_newtons(misfit) > tolerance)
        rows = np.flatnonzero(missing & ~equations.pulls())
        if not len(rows):
            break
        lost = replace(equations, target=equations.target[rows])
        again = _newton(lost, lost.along_the_force(start[rows], number), tolerance, max_iterations)
        better = lost.in_newtons(again[1]) < lost.in_newtons(misfit[rows])
        iterations[rows] += again[2]
        for before, found in ((poses, again[0]), (misfit, again[1]), (stalled, again[3])):
            before[rows[better]] = found[better]
    return poses, misfit, iterations, stalled


def _newton(
    equations: Equilibrium, poses: Array, tolerance: float, max_iterations: int, progress: Progress | None = None
) -> tuple[Array, Array, np.ndarray, np.ndarray]:
    """Poses (n, 6), their misfits (n, targets), iterations (n,), and which stalled (n,)."""
    poses, count = poses.copy(), len(poses)
    r, jacobian, misfit = equations.residuals(poses, np.arange(count))
    fraction, iterations, stalled = np.ones(count), np.zeros(count, dtype=int), np.zeros(count, dtype=bool)
    for _ in range(max_iterations):
        rows = np.flatnonzero((equations.in_newtons(misfit) > tolerance) & ~stalled)
        if progress is not None:
            progress(count - len(rows), count)
        if not len(rows):
            break
        inverse = _damped_inverse(jacobian[rows])
        newton = -np.einsum("nit,nt->ni", inverse, r[rows])
        length = np.abs(newton).max(axis=1)
        reach = np.minimum(fraction[rows], 2.0 / np.maximum(length, 1e-300))  # 2 mm at most
        trial = equations.moved(poses[rows], reach[:, None] * newton)
        r_new, jacobian_new, misfit_new = equations.residuals(trial, rows)
        # Natural monotonicity: the step that is left, measured with the old Jacobian, must shrink. Unlike a sum of
        # squares this does not depend on how the residuals are scaled against one another.
        left = np.abs(np.einsum("nit,nt->ni", inverse, r_new)).max(axis=1)
        better = left <= (1.0 - 0.25 * reach) * length
        for of, new in ((poses, trial), (r, r_new), (jacobian, jacobian_new), (misfit, misfit_new)):
            of[rows[better]] = new[better]
        iterations[rows] += 1
        fraction[rows] = np.where(better, np.minimum(1.0, 2.0 * fraction[rows]), 0.35 * reach)
        # Nothing left to gain: a local least-squares solution, or the limit of arithmetic.
        stalled[rows] = (fraction[rows] < 1e-6) | (length < 1e-12)
    return poses, misfit, iterations, stalled


def _trust_region(
    equations: Equilibrium, row: int, poses: Array, misfit: Array, tolerance: float, max_iterations: int
) -> int:
    """Improve one row of poses and misfit in place, from there, then up to 0.3 mm around; evaluations taken."""
    size, rows, start = len(equations.free), np.array([row]), poses[[row]]
    options = {"xtol": 1e-9, "ftol": 1e-9, "gtol": None, "max_nfev": max_iterations}

    @lru_cache(maxsize=1)  # SciPy asks for the Jacobian where it has asked for the value
    def residuals(steps: bytes) -> tuple[Array, Array, Array]:
        """NaN for steps that are none, which SciPy may take beside singular Jacobians: it keeps where it was."""
        at = np.frombuffer(steps)
        if np.isfinite(at).all():
            return equations.residuals(equations.moved(start, at), rows)
        nothing = np.full((1, len(equations.names)), np.nan)
        return nothing, np.full((*nothing.shape, size), np.nan), nothing

    taken = 0
    for begun in (np.zeros(size), *np.random.default_rng(0).uniform(-0.3, 0.3, (6, size))):
        if not np.isfinite(residuals(begun.tobytes())[0]).all():
            continue
        value, jacobian = (lambda steps, k=k: residuals(steps.tobytes())[k][0] for k in (0, 1))
        with np.errstate(divide="ignore", invalid="ignore"):  # SciPy divides by a step of length zero
            found = least_squares(value, begun, jacobian, **options)
        taken += int(found.nfev)
        left = residuals(found.x.tobytes())[2]
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
