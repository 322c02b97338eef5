"""Proof that a frame is infeasible: no activations and no contact forces balance it, by a linear program.

At a frame's pose contact pushes along one line on each side with a force N_s >= 0 of any size, and muscles give any
activation. The least overload t of the reserves,

    min t    Σ_m arm_m·(active_m·a_m + passive_m) + Σ_s N_s·line_s + r = inverse dynamics,   |r| <= t·size,  0 <= a <= 1

is a global minimum: t > 1 proves that reserves must give more than their size, whatever an optimiser found. It asks
nothing of co-contraction, and holds for the lines of contact at that pose.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from scipy.optimize import linprog

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import contact_on_femur
from casadi_contact.scenes.scene import Scene
from problems.muscle_contact.problem import RESERVE_SIZES, MuscleContact

_LEAST_N = 1.0  # a side that carries less has no line of its own: it pushes upright at its place


@runtime_checkable
class SidesApart(Protocol):
    """A contact model that knows each side's wrench, which surrogates in two stages do not."""

    scene: Scene

    def wrenches(self, poses: Array) -> Array:
        """Wrench (n, sides, 6) of each side [N, N·mm]."""


def least_overload(problem: MuscleContact, model: SidesApart, pose: Array, frame: int) -> float:
    """Least t of a frame at a pose (6,), for muscles with rigid tendons along the walk's arms.

    Raises RuntimeError where the linear program is not solved.
    """
    walk, capacity, names = problem.walk, problem.capacity, problem.balanced
    sizes = np.array([RESERVE_SIZES[name] for name in names])
    arms = np.array([walk.arms[name][frame] for name in names])
    given = np.hstack([arms * capacity.active_n[frame], _lines(problem, model, pose)]) / sizes[:, None]
    wanted = (np.array([walk.loads[name][frame] for name in names]) - arms @ capacity.passive_n[frame]) / sizes
    muscles, variables = arms.shape[1], given.shape[1]
    overload = np.ones((len(names), 1))
    found = linprog(
        np.append(np.zeros(variables), 1.0),
        A_ub=np.block([[given, -overload], [-given, -overload]]),
        b_ub=np.concatenate([wanted, -wanted]),
        bounds=[(0.0, 1.0)] * muscles + [(0.0, None)] * (variables - muscles + 1),
    )
    if not found.success:
        raise RuntimeError(f"the linear program of frame {frame} is not solved: {found.message}")
    return float(found.fun)


def _lines(problem: MuscleContact, model: SidesApart, pose: Array) -> Array:
    """Load on the femur (b, sides) [N, N·m] of balanced coordinates per newton of each side's force."""
    wrenches = model.wrenches(pose[None])[0]  # (sides, 6) on the insert
    columns = []
    for wrench, z in zip(wrenches, model.scene.anchors_mm[:, 2], strict=True):
        size = np.linalg.norm(wrench[:3])
        upright = np.array([0.0, -1.0, 0.0, z, 0.0, -pose[0]])
        fx, fy, fz, *torques = wrench / size if size > _LEAST_N else upright
        loads = contact_on_femur(pose[None], np.array([[fy, 0.0, fx, fz, *torques]]))
        columns.append([loads[name][0] for name in problem.balanced])
    return np.array(columns).T
