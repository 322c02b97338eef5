"""The solution of optimal control, from poses in static equilibrium with the wanted loads."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.optimisation import KNEE_STEPS, IpoptOutcome, ipopt_options, middle_pose, total_selection
from problems import static_equilibrium
from problems.optimal_control.problem import LOAD_SCALE_N, RATES, OptimalControl

_RZ = pose_index("rz")


@dataclass(frozen=True)
class ControlResult:
    """At the collocation points: poses, rates, actuator wrenches about the moving origin (points, 6), contact loads
    (points, L) and how far they are from the wanted ones; node_poses (intervals + 1, 6) at the ends of intervals."""

    poses: Array
    rates: Array
    actuators: Array
    node_poses: Array
    loads: Array
    load_error: Array
    flexion_error_deg: Array
    converged: bool
    ipopt_status: str
    iterations: int
    seconds: float


def start_values(problem: OptimalControl) -> Array:
    """x at poses in static equilibrium with the wanted loads at the ends of intervals, flexion as wanted, and a spline
    between them; actuators at the wanted loads, as if nothing else acted."""
    model, wanted = problem.model, problem.wanted
    node_times = np.linspace(0.0, wanted.time_s[-1] - wanted.time_s[0], problem.intervals + 1)
    loads, rz = wanted.at(wanted.time_s[0] + node_times)
    rest = np.tile(middle_pose(model), (len(node_times), 1))
    rest[:, _RZ] = rz
    total = loads @ total_selection(model.load_names).T
    poses = static_equilibrium.solve(static_equilibrium.build(model, total, rest=rest)).poses
    total[:, 3:] -= np.cross(poses[:, :3], total[:, :3])  # about the moving origin
    motion = CubicSpline(node_times, poses)
    actuators = CubicSpline(node_times, total)(problem.times) / (LOAD_SCALE_N * POSE_IN_MM)
    parts = [part for at in (node_times, problem.times) for part in (motion(at) / KNEE_STEPS, motion(at, 1) / RATES)]
    return np.clip(np.concatenate([part.ravel() for part in (*parts, actuators)]), problem.lower, problem.upper)


def solve(
    problem: OptimalControl, start: Array | None = None, max_iterations: int = 200, print_level: int = 0
) -> ControlResult:
    """Solve with IPOPT from x, `start_values` if left out. Never raises where it does not converge: it is reported."""
    began = time.perf_counter()
    # The start is near the solution: so is the barrier.
    options = ipopt_options(tolerance=1e-6, max_iterations=max_iterations, print_level=print_level, mu_init=1e-3)
    solver = ca.nlpsol("optimal_control", "ipopt", problem.nlp, options)
    x0 = start_values(problem) if start is None else start
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper, lbg=0.0, ubg=0.0)
    outcome = IpoptOutcome.of(solver)
    poses, rates, actuators, node_poses = (np.asarray(part).T for part in problem.unpack(answer["x"]))
    loads = problem.model(poses)
    wanted, rz = problem.wanted.at(problem.wanted.time_s[0] + problem.times)
    return ControlResult(
        poses=poses,
        rates=rates,
        actuators=actuators,
        node_poses=node_poses,
        loads=loads,
        load_error=loads - wanted,
        flexion_error_deg=np.degrees(poses[:, _RZ] - rz),
        converged=outcome.solved,
        ipopt_status=outcome.status,
        iterations=outcome.iterations,
        seconds=time.perf_counter() - began,
    )
