"""Poses of a joint as variables of an optimisation problem, with contact loads that an optimiser can steer by."""

from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.approach import rotate_about_anchors
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import (
    LEVER_MM,
    POSE_NAMES,
    Array,
    as_poses,
    finite_numbers,
    loads_of_total,
    pose_index,
    whole_number,
)
from casadi_contact.core.files.reading import short
from casadi_contact.core.quantities import newton_scales, quantity
from casadi_contact.optimisation.starts import (
    LEAST_START_N,
    middle_pose,
    pose_bounds,
    pose_steps,
    settle_in_range,
    touching,
)
from casadi_contact.scenes.columns import check_reach
from casadi_contact.scenes.normal_load import NormalLoad, centre_of_pressure
from casadi_contact.scenes.pose_space import PoseSpace


class ContactFrames:
    """n frames of a contact for any NLP: scaled free pose parameters q (f, n) as variables, and what follows from them.

    pose (6, n) [mm, rad], loads (L, n) [N, N·mm] of ``load_names`` and signed root loads (P, n) are CasADi expressions;
    lower and upper (f·n,) bound ``vec(q)`` (`pose_bounds`): to what a surrogate has learned, or a scene's reach.

    model: a surrogate, a foundation, or any other contact model, which is called back (`contact.symbolic`).
    locked: pose parameters that do not move, by name: a number, (n,) values or an expression (1, n); all others are
    free, but for those that the scene locks or ties. loads: the named loads that are needed, all if left out. compiled:
    as for the model's `function`. parameters: of a foundation's material and placement (`contact.symbolic.PARAMETERS`)
    by name, given likewise; starts are those of the scene's own. variable: makes q from its shape, ``MX.sym`` if left
    out."""

    def __init__(
        self,
        model: ContactModel,
        frames: int = 1,
        *,
        locked: Mapping[str, Any] | None = None,
        loads: Iterable[str] | None = None,
        compiled: bool = True,
        parameters: Mapping[str, Any] | None = None,
        variable: Callable[[int, int], ca.MX] | None = None,
    ) -> None:
        model, space = symbolic(model), model.scene.pose_space
        locked = _checked_locked(locked, space, frames)
        self.columns = [i for i in space.free if POSE_NAMES[i] not in locked]
        if not self.columns:
            raise ValueError("all free pose parameters are locked, expected at least one that is not")
        self.model, self.frames = model, frames
        self.load_names = model.check_loads(loads)
        self.free = tuple(POSE_NAMES[i] for i in self.columns)
        self._scene, self._locked = model.scene, locked
        self._scales = pose_steps(self._scene.sensitive_pose)[self.columns]
        self.q = variable(len(self.free), frames) if variable else ca.MX.sym("q", len(self.free), frames)
        moving = dict(zip(self.free, ca.vertsplit(ca.mtimes(ca.diag(ca.DM(self._scales)), self.q)), strict=True))
        given = ca.vertcat(*(moving[n] if n in moving else self._row(n, locked.get(n, 0.0)) for n in POSE_NAMES))
        self.pose = given  # `PoseSpace.project` as an expression
        if not space.unconstrained:
            self.pose = ca.mtimes(ca.sparsify(ca.DM(space.matrix)), given) + ca.repmat(ca.DM(space.offset), 1, frames)
        parameters = parameters or {}
        function = model.load_and_root_function(self.load_names, compiled=compiled, batch=frames, parameters=parameters)
        rows = [self._row(*each) for each in parameters.items()]
        self.loads, self.roots = function.call([self.pose, ca.vertcat(*rows)] if rows else [self.pose])
        self._errors: dict[str, ca.MX] = {}  # by name of the targets of `misfit`: load less target [N, N·mm, mm]
        low, high = (np.tile(bound[self.columns] / self._scales, frames) for bound in pose_bounds(model))
        self.lower, self.upper = low, high

    def load(self, name: str) -> ca.MX:
        """A named load (1, n) [N, N·mm]; ValueError for one that is not in ``load_names``."""
        if name not in self.load_names:
            raise ValueError(f"unknown load {name!r}, expected one of {', '.join(self.load_names)}")
        return self.loads[self.load_names.index(name), :]

    def misfit(self, targets: Mapping[str, Any]) -> ca.MX:
        """Residuals (m, n) [N] of target loads, a row for each target: 0 where the contact carries it.

        targets: by name a number, (n,) values or an expression (1, n): loads of ``load_names``, or centres of pressure,
        cop_ap_mm = Tz/Fy and cop_ml_mm = -Tx/Fy (`centre_of_pressure`). The rows are

            2·√(N0·N*)·(s - s*), s* = √(N*/N0)    normal load of a patch, or of patches that one parameter sets together
            (T ∓ c·F)/10 mm                        centre of pressure c
            F - F*, (T - T*)/25 mm                 other forces and torques

        Near the solution the first is the error in N; out of contact it has a derivative, which a load has not. Where a
        normal load is the magnitude of three target forces of direction v, the rows are 2·√(N0·N*)·(s - s*) less
        |F| - F·v, and the two components of F across v.

        Raises ValueError for unknown names, wrong shapes, numbers that are not finite, and normal loads that pull."""
        if not targets:
            raise ValueError("got no target loads, expected some by name, for example {'Fy_med': -600.0}")
        rows: dict[str, ca.MX] = {}
        normals = self._scene.normal_loads
        roots = dict(zip(normals, ca.vertsplit(self.roots), strict=True))
        totals = set(self._scene.controllable_normal_loads) - set(roots)
        roots |= dict.fromkeys(totals, total_root(self.roots))
        for normal, root in roots.items():
            if set(normal.loads) <= set(targets):
                rows |= self._normal_rows(root, normal, [self._row(name, targets[name]) for name in normal.loads])
        for name, value in targets.items():
            if (centre := centre_of_pressure(name, normals)) is not None:
                force, torque, target = self._total(centre.force), self._total(centre.torque), self._row(name, value)
                rows[name] = (torque - centre.sign * target * force) / 10.0
                self._errors[name] = centre.sign * torque / force - target
                continue
            if name in self.load_names or name not in rows:
                self._errors[name] = self.load(name) - self._row(name, value)
            if name not in rows:
                rows[name] = self._errors[name] / newton_scales([name], LEVER_MM)[0]
        return ca.vertcat(*(rows[name] for name in targets))

    def report(self, value: Callable[[ca.MX], Any]) -> str:
        """Findings about a solution, a line for each: the normal load of each patch, errors of the targets of `misfit`,
        frames on a bound, frames that are not valid, frames without contact. value: gives the value of an expression at
        the solution, such as ``solution.value`` of an Opti."""
        pose, roots = (np.reshape(value(of), (-1, self.frames), order="F") for of in (self.pose, self.roots))
        forces = self._scene.reference_load * np.maximum(roots, 0.0) ** 2
        patches = zip(self._scene.patch_names, forces.min(axis=1), forces.max(axis=1), strict=True)
        lines = [", ".join(f"{patch} carries {least:.0f} to {most:.0f} N" for patch, least, most in patches)]
        for name, error in self._errors.items():
            off, unit = np.abs(np.ravel(value(error))), quantity(name).kind.unit
            rms = np.sqrt((off**2).mean())
            lines.append(f"{name} is off by {rms:.2g} {unit} (RMS), {off.max():.2g} in frame {off.argmax()}")
        q = np.ravel(value(self.q), order="F")
        near = 1e-6 * (1.0 + np.abs(q))
        bound = ((q <= self.lower + near) | (q >= self.upper - near)).reshape(self.frames, -1).T
        found: dict[str, Any] = {f"{name} is on its bound": on for name, on in zip(self.free, bound, strict=True)}
        model: Any = self.model
        if getattr(model, "confidence", None) is not None:
            found["validity is below 1/2"] = np.less(model.validity(pose.T), 0.5)
        found["there is no contact"] = (forces <= 0.0).all(axis=0)
        for finding, rows in found.items():
            if rows.any():
                lines.append(f"{finding} in {rows.sum()} of {self.frames} frames, first in {rows.argmax()}")
        return "\n".join(lines)

    def start_poses(self, targets: Mapping[str, ArrayLike] | None = None, poses: ArrayLike | None = None) -> Array:
        """Poses (n, 6) in the learned range and in contact, to begin from: settled from given ones (n, 6) or (6,), the
        middle of the range if left out, turned about the anchors to the locked rotations, along the scene's sensitive
        pose parameters under the target normal loads (other targets are left to the optimiser): a fifth of the scene's
        reference load on each patch if left out. Raises ValueError for locked expressions and unknown loads."""
        space, middle = self._scene.pose_space, middle_pose(self.model)
        rest = np.tile(middle, (self.frames, 1))
        for name, value in self._locked.items():
            if isinstance(value, ca.MX):
                raise ValueError(f"{name} is locked to an expression, expected numbers to find a start with")
            rest[:, pose_index(name)] = value
        moved = [pose_index(name) for name in POSE_NAMES[:3] if name in self.free]
        rest[:, moved] = rotate_about_anchors(self.model, middle, rest)[:, moved]
        rest = space.project(rest)
        if not self.model.record.get("pose_range"):  # nothing learned: the middle touches in one orientation only
            rest = touching(self.model, rest, self.free, {})
        begin = rest if poses is None else self.each_frame(poses)
        normals, pressing = self._scene.normal_loads, dict[str, Array]()
        if targets is None:
            directed = [n for n in self._scene.controllable_normal_loads if n.direction is not None]
            targets = {normal.loads[0]: 0.2 * normal.sign * self._scene.reference_load for normal in directed}
        self.model.check_loads([name for name in targets if centre_of_pressure(name, normals) is None] or None)
        for normal in self._scene.controllable_normal_loads:
            if set(normal.loads) <= set(targets):
                forces = np.stack([_numbers(name, targets[name], self.frames) for name in normal.loads], axis=1)
                pressing |= dict(zip(normal.loads, normal.at_least(forces, LEAST_START_N).T, strict=True))
        return settle_in_range(self.model, begin, rest, self.free, pressing)

    def each_frame(self, poses: ArrayLike) -> Array:
        """A pose (6,), or one for each frame (n, 6), as (n, 6); ValueError for another number of poses."""
        given = as_poses(np.reshape(poses, (1, 6)) if np.shape(poses) == (6,) else poses)
        if len(given) not in (1, self.frames):
            raise ValueError(f"got {len(given)} poses, expected one, or one for each of {self.frames} frames")
        return np.tile(given, (self.frames // len(given), 1))

    def scale(self, name: str) -> float:
        """Size [mm, rad] of a free pose parameter, by which its variable is divided."""
        return float(self._scales[self.free.index(name)])

    def variables(self, poses: Array) -> Array:
        """Values (f·n,) of ``vec(q)`` at poses (n, 6), brought into the bounds."""
        return np.clip((poses[:, self.columns] / self._scales).ravel(), self.lower, self.upper)

    def poses_with(self, poses: Array, values: ArrayLike) -> Array:
        """Poses (m, 6) whose free parameters are those of values (f·m,) of ``vec(q)``, what is tied to them following:
        the inverse of `variables`, for as many frames as there are poses."""
        moved = poses.copy()
        moved[:, self.columns] = np.asarray(values).reshape(len(poses), -1) * self._scales
        return self._scene.pose_space.project(moved)

    def _row(self, name: str, value: Any) -> Any:
        """A value for each frame, (1, n)."""
        if isinstance(value, ca.MX):
            if value.shape not in ((1, 1), (1, self.frames)):
                raise ValueError(f"{name} has shape {value.shape}, expected (1, {self.frames})")
            return value if value.shape[1] == self.frames else ca.repmat(value, 1, self.frames)
        return ca.DM(_numbers(name, value, self.frames)[None])

    def _total(self, component: str) -> ca.MX:
        """A component of the total wrench (1, n), from the patches' where the scene does not name it."""
        names = loads_of_total(component, self.load_names, self._scene.patch_names)
        if not names:
            got = ", ".join(self.load_names)
            raise ValueError(f"a centre of pressure needs {component} in total or of every patch, got {got}")
        first, *others = (self.load(name) for name in names)
        return sum(others, first)

    def _normal_rows(self, got: ca.MX, normal: NormalLoad, target: list[Any]) -> dict[str, ca.MX]:
        """Misfit of the named loads that a normal load is made of, from the root load (1, n) that there is."""
        n0, least = self._scene.reference_load, self._scene.boundary_load
        if normal.component is not None:
            size = normal.sign * target[0]
            if isinstance(size, ca.DM) and (sizes := np.asarray(size)).min() < 0.0:
                said = f"target {normal.loads[0]} pulls by {-sizes.min():.4g} N in frame {sizes.argmin()}"
                raise ValueError(f"{said}, contact only pushes: check its sign")
        else:
            size = ca.sqrt(sum((part**2 for part in target[1:]), target[0] ** 2))
        root = ca.sqrt(size / n0)
        rows = {normal.loads[0]: 2.0 * n0 * ca.fmax(root, np.sqrt(least / n0)) * (got - root)}
        if normal.component is None:
            along = [part / ca.fmax(size, 1e-9) for part in target]
            # The opposite force -F* has the same size and nothing across v. |F| - F·v is zero for F* alone. Targets
            # below least/8 are left out: the floor of √(N*/N0) above would add solutions.
            (fx, fy, fz), (x, y, z) = (self.load(name) for name in normal.loads), along
            pressed = x * fx + y * fy + z * fz
            rows[normal.loads[0]] -= (size > least / 8.0) * (n0 * ca.fmax(got, 0.0) ** 2 - pressed)
            # Across v: the columns of the Householder reflection that maps the first axis onto ±v.
            turn = ca.if_else(x >= 0.0, 1.0, -1.0)
            share = (pressed + turn * fx) / (1.0 + turn * x)
            rows |= {normal.loads[1]: fy - y * share, normal.loads[2]: fz - z * share}
        return rows


def total_root(roots: ca.MX) -> ca.MX:
    """√(Σ max(s, 0)²) (1, n) of root loads s (P, n); where no patch is in contact, the root of the nearest."""
    squares = ca.sum1(ca.fmax(roots, 0.0) ** 2)
    loaded, nearest = squares > 0.0, reduce(ca.fmax, ca.vertsplit(roots))
    return ca.if_else(loaded, ca.sqrt(ca.if_else(loaded, squares, 1.0)), nearest)


def _checked_locked(locked: Mapping[str, Any] | None, space: PoseSpace, frames: int) -> dict[str, Any]:
    """The given locked parameters that the scene leaves free: expressions as they are, numbers as one for each frame;
    ValueError for others that contradict the scene, another count of numbers and angles too large for radians."""
    frames = whole_number("frames", frames, 1)
    locked = {} if locked is None else locked
    symbols = {name: value for name, value in locked.items() if isinstance(value, ca.MX)}
    space.check_free(symbols, "locked to an expression")
    numbers = {name: _numbers(name, value, frames) for name, value in locked.items() if name not in symbols}
    numbers = space.free_curves(numbers, "locked")
    check_reach("locked", numbers)
    return symbols | numbers


def _numbers(name: str, value: Any, frames: int) -> Array:
    """A number for each frame (n,), from one, or n of them in a row or a column."""
    numbers = finite_numbers(value)
    if numbers is None or numbers.size != max(numbers.shape, default=1) or numbers.size not in (1, frames):
        expected = f"expected a finite number, or one for each of {frames} frames"
        raise ValueError(f"{name} is {short(str(value))}, {expected}")
    return np.broadcast_to(numbers.ravel(), frames)
