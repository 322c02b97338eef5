"""Settling by damped dynamics ([EF15 §2.4], "forward dynamic simulation"): apply loads, damp, integrate implicitly."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import NOT_FINITE, Equilibrium, SettleReport
from casadi_contact.core.conventions import (
    WRENCH_NAMES,
    Array,
    angular_velocity_map,
    as_poses,
    check_above_zero,
    rotation,
)


def _conjugate_motion(model: ContactModel, names: Sequence[str], pose: Array) -> Array:
    """Motion (targets, 6) by pose rate along which each target does work.

    A patch's force works on its anchor's velocity, a total force on the origin's, a torque on the angular velocity.
    """
    omega = angular_velocity_map(pose[3:])
    motion = np.zeros((len(names), 6))
    for row, name in enumerate(names):
        component, _, patch = name.partition("_")
        axis = WRENCH_NAMES.index(component)
        if axis >= 3:
            motion[row, 3:] = omega[axis - 3]
            continue
        motion[row, axis] = 1.0
        if patch:
            arm = rotation(pose[3:]) @ model.scene.anchors_mm[model.patch_names.index(patch)]
            motion[row, 3:] = np.cross(omega.T, arm)[:, axis]
    return motion


@dataclass(frozen=True)
class _DampedMotion:
    """The body of one row of the equations, moving from a pose (6,): m·q̈ = Aᵀ·(target - loads) - c·q̇.

    A state (2k,): steps q from there of k free pose parameters [mm, rotations times LEVER_MM], their rates [mm/s].
    """

    equations: Equilibrium
    row: int
    start: Array
    damping: float
    mass: float = 1e-3  # tonne (N, mm, s): 1 kg, and 1 kg at LEVER_MM for rotations

    def pose(self, state: Array) -> Array:
        """The pose (6,) of a state."""
        return self.equations.moved(self.start[None], np.split(state, 2)[0])[0]

    def _by_q(self, by_pose: Array) -> Array:
        """Derivatives (m, k) by q of those by the pose (m, 6)."""
        by_free = self.equations.model.scene.pose_space.pull_back(by_pose)[:, list(self.equations.free)]
        return np.asarray(by_free * self.equations.free_scales)

    def rate(self, _: float, state: Array) -> Array:
        """d state/dt (2k,), by damping alone where loads are not finite: integration then crosses that border."""
        pose, speed = self.pose(state), np.split(state, 2)[1]
        missing = self.equations.target[self.row] - self.equations.model(pose[None])[0, self._loads]
        missing = missing if np.isfinite(missing).all() else np.zeros_like(missing)
        return np.concatenate([speed, (self._motion(pose).T @ missing - self.damping * speed) / self.mass])

    def rate_jacobian(self, _: float, state: Array) -> Array:
        """Derivative (2k, 2k) of the rate by the state; A, and loads without finite derivatives, as constants."""
        pose, one = self.pose(state), np.eye(len(self.equations.free))
        by_q = self._by_q(self.equations.model.jacobian(pose[None])[1][0, self._loads])
        by_q = np.where(np.isfinite(by_q), by_q, 0.0)
        return np.block([[0.0 * one, one], [-self._motion(pose).T @ by_q / self.mass, -self.damping / self.mass * one]])

    def unrest_n(self, state: Array) -> float:
        """The larger of the loads' misfit and of c·q̇ [N, torques over LEVER_MM]."""
        misfit = self.equations.misfit(self.equations.model(self.pose(state)[None]), np.array([self.row]))
        return float(max(self.equations.in_newtons(misfit)[0], self.damping * np.abs(np.split(state, 2)[1]).max()))

    @property
    def _loads(self) -> list[int]:
        return [self.equations.model.load_names.index(name) for name in self.equations.names]

    def _motion(self, pose: Array) -> Array:
        """A (targets, k)."""
        return self._by_q(_conjugate_motion(self.equations.model, self.equations.names, pose))


def _to_rest(motion: _DampedMotion, tolerance: float, end_time: float) -> tuple[Array, int, str]:
    """The pose (6,) that a motion ends at, its steps, and why that is no rest: "" where it is."""

    def unrest(_: float, state: Array) -> float:
        """Above zero before rest, and below where loads are not finite: both end the motion."""
        left = motion.unrest_n(state)
        return float(np.log(max(left, 1e-300) / tolerance)) if np.isfinite(left) else -1.0

    begin = np.zeros(2 * len(motion.equations.free))
    if not np.isfinite(motion.unrest_n(begin)):
        return motion.start, 0, NOT_FINITE
    unrest.terminal = True  # type: ignore[attr-defined]
    options = {"method": "BDF", "jac": motion.rate_jacobian, "events": unrest, "rtol": 1e-8, "atol": 1e-10}
    solution = solve_ivp(motion.rate, (0.0, end_time), begin, **options)
    last = next(state for state in solution.y.T[::-1] if np.isfinite(motion.unrest_n(state)))
    at_rest = motion.unrest_n(last) <= (1.0 + 1e-6) * tolerance
    ended = NOT_FINITE if len(solution.t_events[0]) else f"no rest within {end_time:g} s of damped motion"
    return motion.pose(last), len(solution.t) - 1, "" if at_rest else ended


def relax(
    model: ContactModel,
    poses: ArrayLike,
    free: Sequence[str],
    targets: Mapping[str, ArrayLike],
    *,
    tolerance: float = 1e-4,
    damping: float = 10.0,
    end_time: float = 100.0,
) -> tuple[Array, SettleReport]:
    """Let each pose come to rest under the target loads: m·q̈ = Aᵀ·(target - loads) - c·q̇ until accelerations vanish.

    q are the free pose parameters (rotations times LEVER_MM), A the conjugate motions of the targets, c the joint
    damping [N·s/mm]. The contact is stiff, so integration is implicit: SciPy's ``BDF``. It ends at rest,
    when the loads are met and c·q̇ is small, both within tolerance [N, torques over 25 mm]; a pose that is not at rest
    after end_time [s] is reported, not raised. So is one on whose way the model's loads are not finite: it ends where
    they last were, or stays at its start. Needs as many targets as free parameters.

    Slower than `settle` by far, to the same equilibrium. Raises ValueError as it does, and unless damping, end > 0.
    """
    check_above_zero(tolerance=tolerance, damping=damping, end_time=end_time)
    poses = model.scene.pose_space.project(as_poses(poses).copy())
    equations = Equilibrium.of(model, len(poses), free, targets)
    model = equations.model
    if len(equations.free) != len(equations.names):
        raise ValueError(
            f"{len(equations.names)} targets for {len(equations.free)} free pose parameters, expected as many"
        )
    steps, reason = np.zeros(len(poses), dtype=int), np.full(len(poses), "", dtype=object)
    for k in range(len(poses)):
        motion = _DampedMotion(equations, k, poses[k].copy(), damping)
        poses[k], steps[k], reason[k] = _to_rest(motion, tolerance, end_time)
    misfit = equations.misfit(model(poses), np.arange(len(poses)))
    residual = equations.in_newtons(misfit)
    converged = (reason == "") | (residual <= tolerance)  # at rest the residual is the tolerance, but for rounding
    reason[converged] = ""
    return poses, SettleReport(converged, steps, residual, dict(zip(equations.names, misfit.T, strict=True)), reason)
