"""The solution of optimal control, from poses that carry the wanted loads."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.motion.joint_cycle import JointCycle
from casadi_contact.optimisation import IpoptOutcome, ipopt_options, total_selection
from problems import pose_estimation
from problems.optimal_control.problem import LOAD_SCALE_N, OptimalControl


@dataclass(frozen=True)
class ControlResult:
    """At the collocation points: poses, rates, actuator wrenches about the moving origin (points, 6), contact loads
    (points, L) and how far they are from the wanted ones; held_error (points, h) [mm, rad]; node_poses
    (intervals + 1, 6) at the ends of intervals."""

    poses: Array
    rates: Array
    actuators: Array
    node_poses: Array
    loads: Array
    load_error: Array
    held_error: Array
    converged: bool
    ipopt_status: str
    iterations: int
    seconds: float


def start_values(problem: OptimalControl) -> Array:
    """x at the poses that carry the wanted loads at the ends of intervals (`pose_estimation`), and a spline between
    them; actuators at the wanted loads, as if nothing else acted."""
    model, wanted = problem.model, problem.wanted
    node_times = np.linspace(0.0, wanted.time_s[-1] - wanted.time_s[0], problem.intervals + 1)
    loads, held = wanted.at(wanted.time_s[0] + node_times)
    named = dict(zip(wanted.held, held.T, strict=True)), dict(zip(model.load_names, loads.T, strict=True))
    poses = pose_estimation.solve(pose_estimation.build(model, JointCycle("wanted", node_times, *named))).poses
    total = loads @ total_selection(model.load_names, model.patch_names).T
    total[:, 3:] -= np.cross(poses[:, :3], total[:, :3])  # about the moving origin
    motion = CubicSpline(node_times, poses)
    actuators = CubicSpline(node_times, total)(problem.times) / (LOAD_SCALE_N * POSE_IN_MM)
    steps, rates = problem.steps, problem.rates
    parts = [part for at in (node_times, problem.times) for part in (motion(at) / steps, motion(at, 1) / rates)]
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
    wanted, held = problem.wanted.at(problem.wanted.time_s[0] + problem.times)
    return ControlResult(
        poses=poses,
        rates=rates,
        actuators=actuators,
        node_poses=node_poses,
        loads=loads,
        load_error=loads - wanted,
        held_error=poses[:, [pose_index(name) for name in problem.wanted.held]] - held,
        converged=outcome.solved,
        ipopt_status=outcome.status,
        iterations=outcome.iterations,
        seconds=time.perf_counter() - began,
    )
