"""Pose estimation: the poses of a cycle that carry measured loads and centres of pressure ([EF15 §3.3], any scene).

Measured pose parameters are locked, all others of every frame are free that the scene neither locks nor ties: for a
knee ry and rz are measured, and tx, ty, tz, rx are free. All frames stand in one IPOPT problem with exact Hessian:

    min ½ Σ |r_k(q_k)|² + ½ smoothness·Σ |q_{k+1} - q_k|²    with q_k in the learned range

r are the misfits [N] of the targets (`ContactFrames.misfit`), for a knee

    r = ( 2·√(N0·N*_med)·(s_med - s*_med),  2·√(N0·N*_lat)·(s_lat - s*_lat),
          (Tz - cop_ap*·Fy)/L,  (Tx + cop_ml*·Fy)/L )

with starred values the targets, s = √(N/N0) the signed root load, Fy the model's own total, and L = 10 mm. Forces are
compared as root loads because those are nearly linear in the pose and keep their slope out of contact (near the
solution the residual is the force error); the centre of pressure is written without dividing by the load. Variables
are scaled by the moves that change the residuals alike, so that IPOPT's regularisation bears on all of them alike.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.approach import loading_directions
from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import LEVER_MM, POSE_IN_MM, POSE_NAMES, Array, loads_of_total
from casadi_contact.core.quantities import FORCE, LENGTH, TORQUE, quantity
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.ipopt import FrameOutcome, FrameResult, IpoptOutcome, least_squares_options
from casadi_contact.optimisation.starts import pose_bounds, pose_steps, settle_in_range, touching
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.normal_load import CentreOfPressure, centre_of_pressure
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PoseTargets:
    """Targets of n frames and the loads that they are made of.

    values: targets (n,) by name; load_names: loads needed to evaluate them, in the scene's order; centres: those of the
    targets that are centres of pressure; force_n, cop_mm: how close a solved frame is to each, torques as forces at
    25 mm. Build with `PoseTargets.of`."""

    scene: Scene
    values: Mapping[str, Array]
    load_names: tuple[str, ...]
    centres: Mapping[str, CentreOfPressure]
    force_n: float = 1.0
    cop_mm: float = 0.1

    @classmethod
    def of(cls, scene: Scene, values: Mapping[str, Array]) -> PoseTargets:
        """Raises ValueError for a name that is neither a load of the scene nor a centre of pressure that it has, and
        for two names of one coordinate of the centre."""
        values = {name: np.atleast_1d(np.asarray(curve, dtype=float)) for name, curve in values.items()}
        centres: dict[str, CentreOfPressure] = {}
        needed: set[str] = set()
        for name in values:
            centre = centre_of_pressure(name, scene.normal_loads)
            if centre is None:
                needed.add(name)
                continue
            if same := [other for other, known in centres.items() if known.axis == centre.axis]:
                raise ValueError(f"got {same[0]} and {name}, expected one of them: they are the same coordinate")
            centres[name] = centre
            parts = [_summands(component, scene, values) for component in (centre.force, centre.torque)]
            if not all(parts):
                needs = f"{centre.force} and {centre.torque} among the loads of scene {scene.name}"
                raise ValueError(f"{name} needs {needs}, got {', '.join(scene.load_names)}: add them with tolerances")
            needed |= {*parts[0], *parts[1]}
        if unknown := needed - set(scene.load_names):
            raise ValueError(f"unknown load {', '.join(sorted(unknown))}, expected {', '.join(scene.load_names)}")
        return cls(scene, values, tuple(name for name in scene.load_names if name in needed), centres)

    @property
    def tolerances(self) -> Array:
        """Largest error (targets,) of a solved frame [N, N·mm, mm]."""
        by_kind = {FORCE: self.force_n, TORQUE: self.force_n * LEVER_MM, LENGTH: self.cop_mm}
        return np.array([by_kind[quantity(name).kind] for name in self.values])

    @property
    def loaded(self) -> np.ndarray:
        """True (n,) where something presses, by more than a millionth of the scene's boundary load. Where a normal load
        is not among the targets it may press in any frame: then torques and centres of pressure count too."""
        all_known = all(set(normal.loads) <= set(self.values) for normal in self.scene.normal_loads)
        lever = {FORCE: 1.0} if all_known else {FORCE: 1.0, TORQUE: LEVER_MM}
        kinds = {name: quantity(name).kind for name in self.values}
        sizes = [np.abs(self.values[name]) / lever[kind] for name, kind in kinds.items() if kind in lever]
        if not sizes or (self.centres and not all_known):
            return np.ones(len(next(iter(self.values.values()))), dtype=bool)
        return np.any(np.array(sizes) > 1e-6 * self.scene.boundary_load, axis=0)

    @property
    def pressing(self) -> dict[str, Array]:
        """Targets that normal loads are made of, of those that are targets with all their parts."""
        normals = [n for n in self.scene.controllable_normal_loads if set(n.loads) <= set(self.values)]
        return {name: self.values[name] for normal in normals for name in normal.loads}

    def evaluate(self, loads: Array) -> Array:
        """The targets' quantities (n, targets) at loads (n, L) of load_names; NaN for a centre without load."""
        named, found = dict(zip(self.load_names, loads.T, strict=True)), []
        for name in self.values:
            if (centre := self.centres.get(name)) is None:
                found.append(named[name])
                continue
            parts = (centre.force, centre.torque)
            force, torque = (np.sum([named[n] for n in self._summands(of)], axis=0) for of in parts)
            pressed = centre.pressing * force > 0.0
            found.append(centre.sign * np.where(pressed, torque, np.nan) / np.where(pressed, force, np.nan))
        return np.column_stack(found)

    def errors(self, loads: Array) -> Array:
        """What the loads give minus the targets (n, targets)."""
        return self.evaluate(loads) - np.column_stack(list(self.values.values()))

    def met(self, errors: Array) -> np.ndarray:
        """True (n,) where every error (n, targets) is within its tolerance; False without load."""
        return np.asarray((np.abs(errors) <= self.tolerances).all(axis=1) & self.loaded)

    def as_loads(self) -> dict[str, Array] | None:
        """The same as named loads alone, as `settle` takes them: T = ±c·F for each centre c; None where a centre's
        force is not a target itself."""
        loads = {name: curve for name, curve in self.values.items() if name not in self.centres}
        for name, centre in self.centres.items():
            if centre.torque not in self.scene.load_names or not set(self._summands(centre.force)) <= set(loads):
                return None
            loads[centre.torque] = centre.sign * self.values[name] * self._force(centre)
        return loads

    @property
    def settle_tolerance_n(self) -> Array:
        """Tolerance (n,) [N] to settle `as_loads` with, in decades, at most 0.01 N: so that centres of pressure end
        well within theirs under light loads too."""
        forces = [np.abs(self._force(centre)) for centre in self.centres.values()]
        least = np.min(forces, axis=0) if forces else np.full(len(self.loaded), np.inf)
        least = np.maximum(least, 1e-6 * self.scene.boundary_load)
        return np.asarray(10.0 ** np.floor(np.log10(np.minimum(least * self.cop_mm / LEVER_MM, 0.01))))

    def _force(self, centre: CentreOfPressure) -> Array:
        """Target force (n,) of a centre of pressure."""
        parts = self._summands(centre.force)
        return np.sum([self.values[part] for part in parts if part in self.values] or [np.zeros(len(self))], axis=0)

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def _summands(self, component: str) -> tuple[str, ...]:
        return _summands(component, self.scene, self.values)


def _summands(component: str, scene: Scene, values: Mapping[str, Array]) -> tuple[str, ...]:
    """Loads of the scene that a component of the total wrench is the sum of, of the targets alone if they suffice."""
    targets = [name for name in scene.load_names if name in values]
    patches = scene.patch_names
    return loads_of_total(component, targets, patches) or loads_of_total(component, scene.load_names, patches)


@dataclass(frozen=True)
class PoseResult(FrameResult):
    """Poses (n, 6), loads there (n, L) of the targets' ``load_names``, errors (n, targets) from the targets."""

    poses: Array
    loads: Array
    errors: Array


class PoseEstimation:
    """The problem over all frames of a cycle, which can be inspected unsolved.

        problem = PoseEstimation.of_cycle(cc.load_surrogate("knee"), read_cycle("walk.csv"))
        result = problem.solve()

    targets: measured loads and centres of pressure, measured: pose parameters, by name, each (n,). smoothness
    [N²/mm²] weighs the change from frame to frame.

    nlp: CasADi's x and f; contact: variables with bounds and scales (`ContactFrames`); free: names of the free pose
    parameters; residuals: scaled free
    parameters (f, n) -> r (targets, n) [N]. Raises ValueError for loads that the scene lacks, measured parameters that
    contradict what it locks or ties, and a cycle that measures too little to determine the pose, or too much."""

    def __init__(
        self,
        model: SymbolicContact,
        targets: Mapping[str, Array] | PoseTargets,
        measured: Mapping[str, Array],
        *,
        smoothness: float = 0.0,
    ) -> None:
        if not 0.0 <= smoothness < np.inf:
            raise ValueError(f"smoothness is {smoothness}, expected a finite number >= 0")
        self.model, self.smoothness = model, smoothness
        self.targets = targets if isinstance(targets, PoseTargets) else PoseTargets.of(model.scene, targets)
        self.measured = model.scene.pose_space.free_curves(measured, "measured pose")
        self.frames = len(self.targets)
        self.contact = ContactFrames(model, self.frames, locked=self.measured, loads=self.targets.load_names)
        self.free = self.contact.free
        self._check_determined()
        q, r = self.contact.q, self.contact.misfit(self.targets.values)
        objective = 0.5 * ca.sumsqr(r)
        if smoothness > 0.0 and self.frames > 1:
            in_mm = (POSE_IN_MM * pose_steps(model.scene.sensitive_pose))[self.contact.columns]
            steps_mm = (q[:, 1:] - q[:, :-1]) * ca.repmat(ca.DM(in_mm), 1, self.frames - 1)
            objective += 0.5 * smoothness * ca.sumsqr(steps_mm)
        self.nlp: dict[str, Any] = {"x": ca.vec(q), "f": objective}
        self.residuals = ca.Function("residuals", [q], [r])

    @classmethod
    def of_cycle(cls, model: SymbolicContact, cycle: Cycle, **settings: Any) -> PoseEstimation:
        """The problem of a cycle's targets and measured pose; settings: smoothness."""
        return cls(model, cycle.estimation_targets(), cycle.pose, **settings)

    def _check_determined(self) -> None:
        free, sensitive = self.contact.free, self.model.scene.sensitive_pose
        if len(self.targets.values) < len(free):
            raise ValueError(f"got {', '.join(self.targets.values)} for free {', '.join(free)}: measure as many")
        locked = [name for name in sensitive if name in self.measured]
        if locked and len(self.targets.pressing) > len(sensitive) - len(locked):
            raise ValueError(f"{', '.join(locked)} measured, expected free for {', '.join(self.targets.pressing)}")

    def in_range(self, poses: Array) -> np.ndarray:
        """True (n,) for poses (n, 6) whose free parameters lie within `pose_bounds`."""
        low, high = pose_bounds(self.model)
        return np.asarray(((poses >= low) & (poses <= high))[:, self.contact.columns].all(axis=1))

    def solve(self, start: Array | None = None, max_iterations: int = 300) -> PoseResult:
        """Settle a start (n, 6), by default the middle of the range, and solve with IPOPT.

        Frames that do not converge are reported, never raised. Frames without load stay where they begin."""
        began, loaded = time.perf_counter(), self.targets.loaded
        poses = self.settle_start(self.contact.start_poses({}) if start is None else self.contact.each_frame(start))
        options = least_squares_options(max_iterations=max_iterations)
        solver = ca.nlpsol("pose_estimation", "ipopt", self.nlp, options)
        x0, lower, upper = self.contact.variables(poses), self.contact.lower, self.contact.upper
        fixed = np.repeat(~loaded & (self.smoothness == 0.0), len(self.free))
        answer = solver(x0=x0, lbx=np.where(fixed, x0, lower), ubx=np.where(fixed, x0, upper))
        ipopt = IpoptOutcome.of(solver)
        result = self.evaluate(self.contact.poses_with(poses, answer["x"]), ipopt)
        return replace(result, seconds=time.perf_counter() - began)

    def evaluate(self, poses: Array, ipopt: IpoptOutcome) -> PoseResult:
        """Loads, errors and outcomes of poses (n, 6)."""
        targets = self.targets
        loads = self.model(poses, targets.load_names)
        errors = targets.errors(loads)
        # Without smoothness frames stand alone: one that meets its targets is solved, whatever IPOPT met in another.
        met = targets.met(errors) & (ipopt.solved or self.smoothness == 0.0)
        outcome = FrameOutcome.of(met, (~targets.loaded, FrameOutcome.NO_LOAD))
        return PoseResult(poses, loads, errors, outcome=outcome, ipopt=ipopt)

    def settle_start(self, poses: Array) -> Array:
        """Poses (n, 6) settled frame by frame: the sensitive parameters under the normal loads, inside the learned
        range (`settle_in_range`), outside of which s may have another root; then all free ones under all targets, which
        leaves IPOPT 8 iterations in place of 21 on the built-in walk. Targets that are only parts of normal loads
        settle from a little beyond the first touch."""
        pressing = self.targets.pressing
        poses = settle_in_range(self.model, poses, self.contact.start_poses({}), self.free, pressing, tolerance_n=0.1)
        left = self.settle_rows(poses, np.arange(self.frames))
        return poses if pressing else self._settle_from_touch(poses, left)

    def settle_rows(self, poses: Array, rows: np.ndarray) -> np.ndarray:
        """Settle all free parameters of these rows (k,) of poses (n, 6) under all targets, in place where that ends
        inside the learned range; returns the other rows."""
        loads = self.targets.as_loads()
        if not loads or not len(rows):
            return rows
        given = {name: curve[rows] for name, curve in loads.items()}
        tolerance_n = float(self.targets.settle_tolerance_n[rows].min())
        found, report = settle(self.model, poses[rows], self.free, given, tolerance=tolerance_n)
        good = report.converged & self.in_range(found)
        poses[rows[good]] = found[good]
        return rows[~good]

    def _settle_from_touch(self, poses: Array, left: np.ndarray) -> Array:
        """Settle these rows from a little beyond the first touch, of stiff and of soft layers, along the targets'
        parts of normal loads: at the touch itself loads have no slope."""
        model, values = self.model, self.targets.values
        if not len(left) or self.targets.as_loads() is None:
            return poses
        zero = np.zeros(self.frames)
        forces = {name: values.get(name, zero)[left] for name in model.scene.normal_loads[0].loads}
        touched = touching(model, poses[left], self.free, forces)
        along = loading_directions(model, len(left), forces)
        along[:, [name not in self.free for name in POSE_NAMES[:3]]] = 0.0
        rows = left
        for beyond_mm in (0.05, 0.5):
            again = np.isin(left, rows)
            poses[rows] = touched[again]
            poses[rows, :3] += beyond_mm * along[again]
            rows = self.settle_rows(poses, rows)
        return poses
