"""Static equilibrium: the pose at which contact and soft tissue carry six given loads.

The loads (Fx, Fy, Fz, Tx, Ty, Tz) press the moving body on the fixed one and are given as they reach the fixed body,
about its origin or the moving one. For the free pose parameters i the generalised forces must balance,

    r_i(q) = Q_i(q; loads) - Q_i(q; W(q)) - k_i·(q_i - rest_i) = 0    [N, N·mm]

with Q as in `generalised_forces`, W the contact's wrench and k a stated soft-tissue stiffness. What the scene ties to a
free parameter follows it, and its force counts by the derivative of the tie. Solved as

    min ½ Σ |r_i / L_i|²    with q in the learned range, L = 1 for forces and 25 mm for torques

by IPOPT with exact Hessian, all given loads in one problem. Two condyles without friction cannot carry any six loads:
their forces pass through the axis of the condyle arcs, so nothing holds the flexion rz, and along tz and about ry the
dishes hold only as much as the joint is pressed together. So rz is locked by default; where it is free a spring holds
it, such as `SOFT_TISSUE`. Loads that no pose carries end at the nearest pose in the sense of the sum above.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, WRENCH_NAMES, Array, as_poses, pose_index
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.ipopt import FrameOutcome, FrameResult, IpoptOutcome, least_squares_options
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.optimisation.starts import middle_pose, press_together

SOFT_TISSUE = {"tx": 5.0, "ty": 0.0, "tz": 5.0, "rx": 0.0, "ry": 5.0e3, "rz": 1.0e5}  # a knee's [N/mm, N·mm/rad]


@dataclass(frozen=True)
class EquilibriumResult(FrameResult):
    """Poses (n, 6), contact wrench there (n, 6), and misfit r/L (n, free) [N]."""

    poses: Array
    wrenches: Array
    misfit_n: Array


class StaticEquilibrium:
    """The problem for n rows of loads, which can be inspected unsolved.

        problem = StaticEquilibrium(cc.load_surrogate("knee"), [[0, -1500, 0, 0, 0, 0]], about="moving")
        result = problem.solve()

    loads (n, 6) or (6,) [N, N·mm] as in `WRENCH_NAMES`, about the ``fixed`` or ``moving`` origin. free: pose
    parameters. rest (n, 6) or (6,): values of the locked parameters and ends of the springs, the middle of the learned
    range if left out. stiffness: of springs by pose parameter [N/mm, N·mm/rad]. tolerance: a row is in equilibrium
    where every |r_i/L_i| is at most this share of its force: of 1,500 N 0.15 N and 3.75 N·mm.

    nlp: CasADi's x and f; contact: variables with bounds and scales; residuals: scaled free parameters (f, n) ->
    r/L (f, n) [N]. Raises ValueError for wrong shapes, unknown names, negative stiffness, a free rz without a spring,
    and what contradicts the parameters that the scene locks or ties."""

    def __init__(
        self,
        model: SymbolicContact,
        loads: ArrayLike,
        *,
        free: Sequence[str] = ("tx", "ty", "tz", "rx", "ry"),
        rest: ArrayLike | None = None,
        stiffness: Mapping[str, float] | None = None,
        about: str = "fixed",
        tolerance: float = 1e-4,
    ) -> None:
        self.model, self.about, self.loads = model, about, np.atleast_2d(np.asarray(loads, dtype=float))
        if self.loads.ndim != 2 or self.loads.shape[1] != 6 or not np.isfinite(self.loads).all():
            raise ValueError(f"loads has shape {self.loads.shape}, expected finite (n, 6): {' '.join(WRENCH_NAMES)}")
        space, count = model.scene.pose_space, len(self.loads)
        if not free or len(set(free)) != len(free):
            raise ValueError(f"free is {tuple(free)!r}, expected at least one pose parameter, each named once")
        space.check_free(free)
        springs = dict.fromkeys(POSE_NAMES, 0.0) | dict(stiffness or {})
        if set(springs) != set(POSE_NAMES) or not all(0.0 <= k < np.inf for k in springs.values()):
            raise ValueError(f"stiffness is {stiffness}, expected numbers >= 0 of {', '.join(POSE_NAMES)}")
        if "rz" in free and springs["rz"] == 0.0:
            raise ValueError("rz is free, expected locked or with a spring: contact does not hold flexion")
        self.stiffness = np.array(list(springs.values()))
        at = np.asarray(middle_pose(model) if rest is None else rest, dtype=float)
        self.rest = as_poses(np.broadcast_to(at, (count, 6)) if at.shape == (6,) else at)
        if len(self.rest) != count:
            raise ValueError(f"rest has {len(self.rest)} poses, expected one, or one for each of {count} loads")
        space.free_curves(dict(zip(POSE_NAMES, self.rest.T, strict=True)), "rest")

        locked = {name: self.rest[:, pose_index(name)] for name in space.free_names if name not in free}
        self.contact = ContactFrames(model, count, locked=locked)
        self.free = self.contact.free  # in the order of a pose
        self._total = total_selection(self.contact.load_names, model.patch_names)
        balance = self._balance().map(count)
        r = balance(self.contact.pose, self.contact.loads, ca.DM(self.loads.T), ca.DM(self.rest.T))
        self.nlp: dict[str, Any] = {"x": ca.vec(self.contact.q), "f": 0.5 * ca.sumsqr(r)}
        self.residuals = ca.Function("residuals", [self.contact.q], [r])
        # A millionth of a newton is what rounding may leave, however light the loads are.
        self.tolerance_n = np.maximum(tolerance * np.linalg.norm(self.loads[:, :3], axis=1), 1e-6)

    def _balance(self) -> ca.Function:
        """(pose (6), contact loads (L), given loads (6), rest (6)) of one row -> r/L of the free parameters (f) [N]."""
        names = (("pose", 6), ("contact", len(self.contact.load_names)), ("loads", 6), ("rest", 6))
        pose, contact, loads, rest = (ca.MX.sym(name, size) for name, size in names)
        wrench = ca.mtimes(ca.sparsify(ca.DM(self._total)), contact)
        given, carried = generalised_forces(pose, loads, about=self.about), generalised_forces(pose, wrench)
        space = self.model.scene.pose_space
        forces = given - carried - ca.DM(self.stiffness) * (pose - rest)
        if not space.unconstrained:
            forces = ca.mtimes(ca.sparsify(ca.DM(space.matrix.T)), forces)
        r = forces / ca.DM(POSE_IN_MM)
        return ca.Function("balance", [pose, contact, loads, rest], [r[self.contact.columns]])

    @property
    def pulls(self) -> np.ndarray:
        """True (n,) for loads that contact carries in no pose: patches that are all pressed along one direction d have
        F·d > 0, and so has the given force where the translation along d is free and no spring or tie acts on it."""
        normals, space = self.model.scene.normal_loads, self.model.scene.pose_space
        none = np.zeros(len(self.loads), dtype=bool)
        if len({(normal.component, normal.sign) for normal in normals}) > 1 or normals[0].index is None:
            return none
        along = normals[0].index
        held = np.count_nonzero(space.matrix[:, along]) > 1 or self.stiffness[along] > 0.0
        return none if held or POSE_NAMES[along] not in self.free else normals[0].sign * self.loads[:, along] <= 0.0

    def rows(self, rows: np.ndarray) -> StaticEquilibrium:
        """The problem of these rows alone."""
        springs = dict(zip(POSE_NAMES, self.stiffness.tolist(), strict=True))
        problem = StaticEquilibrium(
            self.model, self.loads[rows], free=self.free, rest=self.rest[rows], stiffness=springs, about=self.about
        )
        problem.tolerance_n = self.tolerance_n[rows]
        return problem

    def misfit_n(self, poses: Array) -> Array:
        """r/L (n, f) [N] in poses (n, 6)."""
        q = self.contact.variables(poses).reshape(len(poses), -1).T
        return np.asarray(self.residuals(q)).T

    def solve(
        self, start: ArrayLike | None = None, *, restarts: int = 0, max_iterations: int = 300
    ) -> EquilibriumResult:
        """Solve with IPOPT from a start (n, 6), the rest poses if left out, brought into the learned range and settled
        by `press_together`. restarts: how often rows that stay unsolved begin again beside the pose of the solved row
        that is nearest; a convex body, such as a natural tibia, has minima off balance. Loads that no pose carries are
        reported, never raised."""
        began = time.perf_counter()
        poses, ipopt = self.contact.each_frame(self.rest if start is None else start), IpoptOutcome("Not_Needed", 0)
        left, iterations = np.flatnonzero(~self.pulls), 0
        solved, rng = np.zeros(len(poses), dtype=bool), np.random.default_rng(11)
        aside = np.array([6.0, 0.0, 3.0, 0.1, 0.3, 0.0])  # [mm, rad]; what presses is settled at every start
        for attempt in range(restarts + 1):
            if not len(left):
                break
            problem = self if len(left) == len(poses) else self.rows(left)
            begin = poses[left]
            if attempt:
                known = np.flatnonzero(solved) if solved.any() else left
                apart = np.linalg.norm((self.rest[left, None] - self.rest[known]) * POSE_IN_MM, axis=2)
                nearest = (poses if solved.any() else self.rest)[known[apart.argmin(axis=1)]]
                begin = nearest + rng.uniform(-1.0, 1.0, (len(left), 6)) * aside
            tried, ipopt = problem._optimum(begin, max_iterations)
            iterations += ipopt.iterations
            met = np.abs(problem.misfit_n(tried)).max(axis=1) <= problem.tolerance_n
            replaced = np.full(len(left), True) if not attempt else met
            poses[left[replaced]], solved[left[met]] = tried[replaced], True
            left = left[~met]
        return EquilibriumResult(
            poses=poses,
            wrenches=self.model(poses, self.contact.load_names) @ self._total.T,
            misfit_n=self.misfit_n(poses),
            outcome=FrameOutcome.of(solved),
            ipopt=replace(ipopt, iterations=iterations),
            seconds=time.perf_counter() - began,
        )

    def _optimum(self, start: Array, max_iterations: int) -> tuple[Array, IpoptOutcome]:
        pressed = press_together(self.model, start, self.rest, self.loads, self.free)
        options = least_squares_options(max_iterations=max_iterations)
        solver = ca.nlpsol("static_equilibrium", "ipopt", self.nlp, options)
        contact = self.contact
        answer = solver(x0=contact.variables(pressed), lbx=contact.lower, ubx=contact.upper)
        return contact.poses_with(pressed, answer["x"]), IpoptOutcome.of(solver)
