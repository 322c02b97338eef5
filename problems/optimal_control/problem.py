"""Optimal control of a joint: find the actuator loads whose motion carries wanted contact loads, all six degrees free.

Direct collocation (Radau or Legendre points) over one cycle of N intervals, all in one IPOPT problem with exact
Hessian. With pose q (6), rates v (6) and actuator wrenches u (6) about the moving origin at every collocation point,

    q̇ = v,    M·v̇ = Q(q; u) - Q(q; W(q)) - k·(q - q_rest) - c·v

(as in the knee simulator, with flexion now moving as freely as the rest; other joints have no springs k), find

    min ½ Σ |(loads(q) - wanted)/L|² + ½ Σ |(held q - wanted)/δ|² + ½ steadiness·Σ |Δu/L|²    [N²]

over the collocation points: L = 1 for forces and 25 mm for torques, δ = 0.01 degrees and 0.01 mm (contact does not hold
the flexion of a knee or any rotation of a ball, so wanted loads alone leave them open), Δu the change from point to
point. Poses stay in the learned range; the cycle is periodic by choice. Poses, rates and dynamics are scaled to like
size.

The wanted loads of a knee are those that a forward simulation of the knee simulator carries, so the answer is known:
the simulator's motion, and its applied loads as controls. Those of another joint are what its own cycle carries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import LEVER_MM, POSE_IN_MM, Array, pose_index
from casadi_contact.optimisation import generalised_forces, pose_bounds, pose_steps, total_selection
from casadi_contact.optimisation.collocation import Collocation, Unknowns
from casadi_contact.quantities import newton_scales
from problems.knee_simulator.rig import Rig
from problems.optimal_control.wanted_cycle import WantedCycle

HELD = {"t": 0.01, "r": np.radians(0.01)}  # [mm, rad]: what is held and off by this weighs as a force off by 1 N
_FLEXION_INERTIA = 20.0  # t·mm², that is 0.02 kg·m², as about the other axes
_FLEXION_DAMPING = 1000.0  # N·mm·s/rad
RATE_PER_S = 20.0  # over that many steps of the pose, like in effect
_LEAST_POINTS = 4  # of a cubic spline
LOAD_SCALE_N = 100.0  # of actuator loads (torques over 25 mm) and dynamics


@dataclass(frozen=True)
class OptimalControl:
    """A problem that can be looked at unsolved: CasADi's nlp and bounds, collocation times, and what it came from.

    times (points,) are those of the collocation points; unpack: x -> poses (6, points), rates (6, points), actuator
    wrenches (6, points) and poses at the ends of intervals (6, intervals + 1), in physical units.
    """

    model: SymbolicContact
    wanted: WantedCycle
    times: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    unpack: ca.Function
    intervals: int
    degree: int

    @property
    def steps(self) -> Array:
        """What one unit of each pose variable is (6,) [mm, rad]."""
        return pose_steps(self.model.scene.sensitive_pose)

    @property
    def rates(self) -> Array:
        """What one unit of each rate is (6,) [mm/s, rad/s]."""
        return RATE_PER_S * self.steps


def point_function(model: SymbolicContact, rig: Rig, held: Sequence[str]) -> ca.Function:
    """(scaled q, v, u, wanted loads, wanted held) -> (acceleration forces (6) [N], tracking residuals (L + h) [N])."""
    q, v, u = (ca.MX.sym(name, 6) for name in ("q", "v", "u"))
    wanted, wanted_held = ca.MX.sym("wanted", len(model.load_names)), ca.MX.sym("held", len(held))
    steps = pose_steps(model.scene.sensitive_pose)
    pose = q * steps
    loads = model.function(compiled=True)(pose)
    contact = ca.mtimes(ca.DM(total_selection(model.load_names, model.patch_names)), loads)
    actuators = u * (LOAD_SCALE_N * POSE_IN_MM)
    stiffness, rest = np.append(rig.stiffness, 0.0), np.append(rig.rest_mm_rad, 0.0)
    damping = np.append(rig.damping, _FLEXION_DAMPING)
    forces = (
        generalised_forces(pose, actuators, about="moving")
        - generalised_forces(pose, contact)
        - ca.DM(stiffness) * (pose - ca.DM(rest))
        - ca.DM(damping) * (v * RATE_PER_S * steps)
    )
    levers = newton_scales(model.load_names, LEVER_MM)
    columns, weighs = [pose_index(name) for name in held], ca.DM([HELD[name[0]] for name in held])
    off = ca.vertcat((loads - wanted) / ca.DM(levers), (pose[columns] - wanted_held) / weighs)
    return ca.Function("point", [q, v, u, wanted, wanted_held], [forces / ca.DM(POSE_IN_MM), off])


def inertia_of(rig: Rig) -> Array:
    """Diagonal of M (6,) [t, t·mm²]."""
    return np.append(rig.inertia, _FLEXION_INERTIA)


def build(
    model: SymbolicContact,
    wanted: WantedCycle,
    *,
    intervals: int = 50,
    degree: int = 3,
    scheme: str = "radau",
    periodic: bool = True,
    steadiness: float = 1e-4,
) -> OptimalControl:
    """Transcribe the cycle. Raises ValueError for an unknown scheme, too few intervals or points, a negative
    steadiness, loads that lack a component of the wrench, and a scene that locks or ties pose parameters."""
    model.scene.pose_space.check_whole("optimal control")
    if not 0.0 <= steadiness < np.inf:
        raise ValueError(f"steadiness is {steadiness}, expected a number >= 0")
    grid = Collocation(intervals, degree, wanted.time_s[-1] - wanted.time_s[0], scheme)
    points = intervals * degree
    if points < _LEAST_POINTS:
        raise ValueError(
            f"{intervals} intervals of degree {degree} have {points} collocation points, expected {_LEAST_POINTS} or "
            "more: cubic splines through them drive the motion forward in time"
        )
    if wanted.loads.shape != (len(wanted.time_s), len(model.load_names)):
        raise ValueError(
            f"wanted loads have shape {wanted.loads.shape}, expected "
            f"({len(wanted.time_s)}, {len(model.load_names)}): {' '.join(model.load_names)}"
        )
    steps = pose_steps(model.scene.sensitive_pose)
    low, high = (bound / steps for bound in pose_bounds(model))
    unknowns = Unknowns()
    nodes_q = unknowns.add("node_q", 6, intervals + 1, low, high)
    nodes_v = unknowns.add("node_v", 6, intervals + 1)
    q, v, u = (unknowns.add("q", 6, points, low, high), unknowns.add("v", 6, points), unknowns.add("u", 6, points))
    loads, held = wanted.at(wanted.time_s[0] + grid.times_s)
    point = point_function(model, wanted.rig, tuple(wanted.held))
    forces, off = point.map(points)(q, v, u, ca.DM(loads.T), ca.DM(held.T))
    defects = _defects(grid, steps, inertia_of(wanted.rig), (nodes_q, nodes_v), (q, v), forces)
    if periodic:
        defects += [nodes_q[:, 0] - nodes_q[:, -1], nodes_v[:, 0] - nodes_v[:, -1]]
    changes = LOAD_SCALE_N * (u[:, 1:] - u[:, :-1])
    lower, upper = unknowns.bounds
    units = ((q, steps), (v, RATE_PER_S * steps), (u, LOAD_SCALE_N * POSE_IN_MM), (nodes_q, steps))
    physical = [ca.repmat(ca.DM(unit), 1, part.shape[1]) * part for part, unit in units]
    return OptimalControl(
        model=model,
        wanted=wanted,
        times=grid.times_s,
        nlp={
            "x": unknowns.x,
            "f": 0.5 * (ca.sumsqr(off) + steadiness * ca.sumsqr(changes)),
            "g": ca.vertcat(*defects),
        },
        lower=lower,
        upper=upper,
        unpack=ca.Function("unpack", [unknowns.x], physical),
        intervals=intervals,
        degree=degree,
    )


def _defects(
    grid: Collocation,
    steps: Array,
    inertia: Array,
    nodes: tuple[ca.MX, ca.MX],
    points: tuple[ca.MX, ca.MX],
    forces: ca.MX,
) -> list[ca.MX]:
    """What is zero where scaled poses and rates, at nodes and at points, follow the forces (6, points) [N] at these."""
    (nodes_q, nodes_v), (q, v) = nodes, points
    to_newtons = ca.DM(inertia * (RATE_PER_S * steps) / POSE_IN_MM / grid.step_s)
    return [
        ca.vec(grid.derivatives(nodes_q, q) - RATE_PER_S * grid.step_s * v),
        ca.vec(ca.repmat(to_newtons, 1, q.shape[1]) * grid.derivatives(nodes_v, v) - forces) / LOAD_SCALE_N,
        ca.vec(grid.jumps(nodes_q, q)),
        ca.vec(grid.jumps(nodes_v, v)),
    ]
