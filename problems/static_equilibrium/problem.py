"""Settling: the pose at which contact and soft tissue carry six given loads.

The loads (Fx, Fy, Fz, Tx, Ty, Tz) press the moving body on the fixed one and are given as they reach the fixed body,
about its origin or the moving one. For the free pose parameters i the generalised forces must balance,

    r_i(q) = Q_i(q; loads) - Q_i(q; W(q)) - k_i·(q_i - rest_i) = 0    [N, N·mm]

(Q as in `generalised_forces`, W the contact's wrench, k the stated soft-tissue stiffness; what the scene ties to a free
parameter follows it, and its force counts by the slope of the tie), solved as

    min ½ Σ |r_i / L_i|²    with q in the learned range, L = 1 for forces and 25 mm for torques

by IPOPT with exact Hessian, all given loads in one problem. Without springs (k = 0) and with all six parameters free
this asks for W(q) = loads. Two condyles without friction cannot carry any six loads: their forces pass through the
axis of the condyle arcs, so nothing holds the flexion rz, and along tz and about ry the dishes hold only as much as
the joint is pressed together. So rz is locked by default, and where it is free a spring holds it; `SOFT_TISSUE` are
stated springs of about the size of a knee held by its tissue and muscles, used where asked for. Loads that no pose
carries end at the nearest pose in the sense of the sum above and are reported with the reason; those that do not press
the bodies together are not sought at all (`pulls`). In equilibrium every |r_i / L_i| is at most `BALANCED` times the
given force: of 1,500 N 0.15 N and 3.75 N·mm, which is the centre of pressure to 2.5 µm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, WRENCH_NAMES, Array, as_poses, pose_index
from casadi_contact.optimisation.contact_frames import pose_in_space
from casadi_contact.optimisation.joint_mechanics import generalised_forces, wrench_function
from casadi_contact.optimisation.starts import KNEE_STEPS, middle_pose, pose_bounds
from casadi_contact.scenes.pose_space import PoseSpace

FREE = ("tx", "ty", "tz", "rx", "ry")
SOFT_TISSUE = {"tx": 5.0, "ty": 0.0, "tz": 5.0, "rx": 0.0, "ry": 5.0e3, "rz": 1.0e5}  # [N/mm, N·mm/rad]
BALANCED = 1e-4  # of the given force, torques over 25 mm: contact models are off by more
_ROUNDING_N = 1e-6  # what rounding may leave, however light the wanted loads are


@dataclass(frozen=True)
class StaticEquilibrium:
    """A problem that can be looked at unsolved: CasADi's nlp, bounds on its variables, and what it came from.

    loads (n, 6) as in `WRENCH_NAMES`; rest (n, 6) poses: values of the locked parameters and ends of the springs;
    stiffness (6,); residuals: function of the stacked scaled free parameters (f, n) -> r/L (f, n) [N].
    """

    model: SymbolicContact
    loads: Array
    about: str
    free: tuple[str, ...]
    rest: Array
    stiffness: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    residuals: ca.Function

    @property
    def columns(self) -> list[int]:
        """Columns of the free parameters in a pose array."""
        return [pose_index(name) for name in self.free]

    def variables(self, poses: Array) -> Array:
        """Scaled free parameters (..., f) of poses (..., 6)."""
        return np.asarray(poses[..., self.columns] / KNEE_STEPS[self.columns])

    def moved(self, poses: Array, values: Array) -> Array:
        """Poses (n, 6) with the free parameters of scaled ones (n, f), what is tied to them following."""
        moved = poses.copy()
        moved[:, self.columns] = values * KNEE_STEPS[self.columns]
        return self.model.scene.pose_space.onto(moved)

    def misfit_n(self, poses: Array) -> Array:
        """r/L (n, f) [N] in poses (n, 6)."""
        return np.asarray(self.residuals(self.variables(poses).T)).T

    @property
    def tolerance_n(self) -> Array:
        """How far off balance a row in equilibrium may be (n,) [N], torques over 25 mm."""
        return np.maximum(BALANCED * np.linalg.norm(self.loads[:, :3], axis=1), _ROUNDING_N)

    def of_rows(self, rows: np.ndarray) -> StaticEquilibrium:
        """The problem of these rows, by number or by truth, alone."""
        held: dict[str, Any] = {"free": self.free, "rest": self.rest[rows], "stiffness": self.stiffness}
        return build(self.model, self.loads[rows], **held, about=self.about)


def residual_function(
    contact: ca.Function, free: Sequence[str], about: str, stiffness: Array, space: PoseSpace
) -> ca.Function:
    """(scaled free q (f), loads (6), rest (6)) -> r/L of the free parameters (f) [N], in a scene's pose space."""
    columns = [pose_index(name) for name in free]
    q, loads, rest = ca.MX.sym("q", len(columns)), ca.MX.sym("loads", 6), ca.MX.sym("rest", 6)
    entries = [q[columns.index(i)] * KNEE_STEPS[i] if i in columns else rest[i] for i in range(6)]
    pose = pose_in_space(space, ca.vertcat(*entries))
    given = generalised_forces(pose, loads, about=about)
    carried = generalised_forces(pose, contact(pose))
    forces = given - carried - ca.DM(stiffness) * (pose - rest)
    if not space.whole:
        forces = ca.mtimes(ca.sparsify(ca.DM(space.matrix.T)), forces)
    r = forces / ca.DM(POSE_IN_MM)
    return ca.Function("residuals", [q, loads, rest], [r[columns]])


def build(
    model: SymbolicContact,
    loads: ArrayLike,
    *,
    free: Sequence[str] = FREE,
    rest: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    about: str = "fixed",
) -> StaticEquilibrium:
    """Pose the problem for loads (n, 6) about the ``fixed`` or ``moving`` origin.

    rest: poses (n, 6) or (6,) of the scene's pose space that hold what is not free and where springs are slack (the
    middle of the learned range if left out); stiffness (6,) [N/mm, N·mm/rad], none if left out.
    Raises ValueError for wrong shapes, unknown names, negative stiffness, six free parameters without a spring on rz,
    and for free names and rest poses that contradict what the scene locks or ties.
    """
    wanted = _finite_loads(loads)
    if not free or len(set(free)) != len(free):
        raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
    columns, space = [pose_index(name) for name in free], model.scene.pose_space
    space.check_free(free)
    springs = np.zeros(6) if stiffness is None else np.asarray(stiffness, dtype=float)
    if springs.shape != (6,) or not (np.isfinite(springs) & (springs >= 0.0)).all():
        raise ValueError(f"stiffness is {springs.tolist()}, expected 6 numbers >= 0: {' '.join(POSE_NAMES)}")
    if "rz" in free and springs[pose_index("rz")] == 0.0:
        raise ValueError("rz is free but contact does not hold flexion: lock rz, or give it a spring")
    count = len(wanted)
    at = np.asarray(middle_pose(model) if rest is None else rest, dtype=float)
    poses = as_poses(np.broadcast_to(at, (count, 6)) if at.shape == (6,) else at)
    if len(poses) != count:
        raise ValueError(f"rest has {len(poses)} poses, expected one, or one for each of {count} loads")
    space.free_curves(dict(zip(POSE_NAMES, poses.T, strict=True)), "rest")
    residual = residual_function(wrench_function(model), free, about, springs, space)
    q = ca.MX.sym("q", len(columns), count)
    residuals = residual.map(count)(q, ca.DM(wanted.T), ca.DM(poses.T))
    nlp = {"x": ca.vec(q), "f": 0.5 * ca.sumsqr(residuals)}
    low, high = (np.tile((bound / KNEE_STEPS)[columns], count) for bound in pose_bounds(model))
    return StaticEquilibrium(
        model=model,
        loads=wanted,
        about=about,
        free=tuple(free),
        rest=poses,
        stiffness=springs,
        nlp=nlp,
        lower=low,
        upper=high,
        residuals=ca.Function("all_residuals", [q], [residuals]),
    )


def _finite_loads(loads: ArrayLike) -> Array:
    """Loads (n, 6), from as many or (6,); ValueError for another shape and for what is not finite."""
    wanted = np.atleast_2d(np.asarray(loads, dtype=float))
    if wanted.ndim != 2 or wanted.shape[1] != 6:
        raise ValueError(f"loads has shape {wanted.shape}, expected (n, 6): {' '.join(WRENCH_NAMES)}")
    for row, column in np.argwhere(~np.isfinite(wanted)):
        raise ValueError(
            f"loads holds {wanted[row, column]} at row {row} ({WRENCH_NAMES[column]}), expected finite numbers"
        )
    return wanted
