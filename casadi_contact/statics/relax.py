"""Settling by damped dynamics ([EF15 §2.4], "forward dynamic simulation"): apply loads, damp, integrate implicitly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import WRENCH_NAMES, Array, angular_velocity_map, rotation
from casadi_contact.statics.equilibrium import Equilibrium, start_copy
from casadi_contact.statics.settle import SettleReport

_MASS = 1e-3  # tonne (N, mm, s): 1 kg, and 1 kg at LEVER_MM for rotations


def _conjugate_motion(model: ContactModel, names: Sequence[str], pose: Array) -> Array:
    """Motion (targets, 6) by pose rate along which each target does work.

    A patch's force works on the velocity of the patch's anchor, a total force on that of the moving origin, a torque
    on the angular velocity.
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


def relax(
    model: ContactModel,
    poses: ArrayLike,
    free: Sequence[str],
    targets: Mapping[str, ArrayLike],
    *,
    tolerance: float = 1e-4,
    damping: float = 10.0,
    end_time: float = 100.0,
    method: str = "BDF",
) -> tuple[Array, SettleReport]:
    """Let each pose come to rest under the wanted loads: m·q̈ = Aᵀ·(wanted - loads) - c·q̇ until accelerations vanish.

    q are the free pose parameters (rotations times LEVER_MM), A the conjugate motions of the targets, c the joint
    damping [N·s/mm]. The contact is stiff, so integration is implicit: SciPy's ``BDF`` or ``Radau``. It ends at rest,
    when the loads are met and c·q̇ is small, both within tolerance [N, torques over 25 mm]; a pose that is not at rest
    after end_time [s] is reported, not raised. Needs as many targets as free parameters.

    Slower than `settle` by orders of magnitude; both find the same equilibrium. Raises ValueError like `settle`.
    """
    poses, space = start_copy(model, poses), model.scene.pose_space
    equations = Equilibrium.of(model, len(poses), free, targets)
    model = equations.model
    columns, scales = list(equations.free), equations.free_scales
    if len(columns) != len(equations.names):
        raise ValueError(f"{len(equations.names)} targets for {len(columns)} free pose parameters, expected as many")
    loads_of = [model.load_names.index(name) for name in equations.names]
    size = len(columns)
    steps, rests = np.zeros(len(poses), dtype=int), np.zeros(len(poses), dtype=bool)

    for k in range(len(poses)):

        def pose_at(state: Array, k: int = k) -> Array:
            pose = poses[k].copy()
            pose[columns] = state[:size] * scales
            return space.onto(pose)

        def motion_of(pose: Array) -> Array:
            return space.along(_conjugate_motion(model, equations.names, pose))[:, columns] * scales

        def rate(_: float, state: Array, k: int = k) -> Array:
            pose = pose_at(state)
            force = motion_of(pose).T @ (equations.wanted[k] - model(pose[None])[0, loads_of])
            return np.concatenate([state[size:], (force - damping * state[size:]) / _MASS])

        def rate_slope(_: float, state: Array) -> Array:
            pose, slope = pose_at(state), np.zeros((2 * size, 2 * size))
            by_q = space.along(model.jacobian(pose[None])[1][0, loads_of])[:, columns] * scales
            slope[:size, size:] = np.eye(size)
            slope[size:, :size] = -motion_of(pose).T @ by_q / _MASS
            slope[size:, size:] = -damping / _MASS * np.eye(size)
            return slope

        def unrest(_: float, state: Array, k: int = k) -> float:
            misfit = equations.misfit(model(pose_at(state)[None]), np.array([k]))
            moving = damping * float(np.abs(state[size:]).max())
            return float(np.log(max(equations.in_newtons(misfit)[0], moving, 1e-300) / tolerance))

        unrest.terminal = True  # type: ignore[attr-defined]
        start = np.concatenate([poses[k, columns] / scales, np.zeros(size)])
        solution = solve_ivp(
            rate, (0.0, end_time), start, method=method, jac=rate_slope, events=unrest, rtol=1e-8, atol=1e-10
        )
        poses[k] = pose_at(solution.y[:, -1])
        steps[k], rests[k] = len(solution.t) - 1, solution.status == 1

    misfit = equations.misfit(model(poses), np.arange(len(poses)))
    residual = equations.in_newtons(misfit)
    converged = rests | (residual <= tolerance)  # at rest the residual is the tolerance, but for rounding
    reason = np.where(converged, "", f"no rest within {end_time:g} s of damped motion").astype(object)
    misfits = {name: misfit[:, column] for column, name in enumerate(equations.names)}
    return poses, SettleReport(converged, steps, residual, misfits, reason)
