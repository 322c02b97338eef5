"""Optimal control of a knee by direct collocation: actuator loads whose motion carries target contact loads.

    states      pose q (6) and rates v (6), at the nodes of N intervals and at 3 Radau points in each
    controls    actuator wrench u (6) about the moving origin, at the Radau points
    minimise    ½ Σ |(loads(q) - target)/L|² + ½ Σ ((rz - target rz)/δ)² + ½ ε Σ |Δu/L|²    [N²]
    subject to  q̇ = v,    M·v̇ = Q(q; u) - Q(q; contact(q)) - k·q - c·v,    one period

L is 1 for forces and 25 mm for torques, δ = 0.01° (contact does not hold flexion), Δu the change from point to point,
ε = 1e-4. M, k and c are those of the knee simulator. The target loads are what its second cycle carries, so the answer
is known: the simulator's motion, with its applied loads as controls.

The check: the found controls drive the same equations forward in time, by CVODES, with rz prescribed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.core.quantities import newton_scales
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.ipopt import ipopt_options
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.starts import pose_bounds, pose_steps, press_together
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.pose_file import write_poses
from problems import knee_simulator
from problems.collocation import Collocation
from problems.contact_source import load_contact
from problems.knee_simulator import Rig

INERTIA = np.append(Rig().inertia, 20.0)  # t, t·mm²; the last of flexion, which moves as freely as the rest
DAMPING = np.append(Rig().damping, 1000.0)
STIFFNESS = np.append(Rig().stiffness, 0.0)


@dataclass(frozen=True)
class Target:
    """Loads (n, L) [N, N·mm] and flexion rz (n,) [rad], the targets at time_s (n,), over one period from 0."""

    time_s: Array
    loads: Array
    rz: Array


def simulated(model: SymbolicContact, frames: int = 401) -> Target:
    """What the second cycle of the knee simulator carries, by then periodic."""
    simulator = knee_simulator.build(model)
    start = knee_simulator.start_state(simulator)
    motion = knee_simulator.simulate(simulator, start, cycles=2.0, frames=2 * frames - 1, tolerance=1e-8)
    poses = motion.poses[frames - 1 :]
    return Target(motion.time_s[:frames], model(poses), poses[:, 5])


def acceleration_forces(model: SymbolicContact) -> ca.Function:
    """(pose, rates, actuator wrench) -> M·v̇ (6) [N, N·mm] and contact loads (L)."""
    pose, rates, actuators = (ca.MX.sym(name, 6) for name in ("pose", "rates", "actuators"))
    loads = model.function()(pose)
    contact = ca.DM(total_selection(model.load_names, model.patch_names)) @ loads
    forces = generalised_forces(pose, actuators, about="moving") - generalised_forces(pose, contact)
    forces -= ca.DM(STIFFNESS) * pose + ca.DM(DAMPING) * rates
    return ca.Function("forces", [pose, rates, actuators], [forces, loads])


@dataclass(frozen=True)
class Control:
    """At the collocation points, time_s (n,): poses, rates and actuator wrenches (n, 6), contact loads (n, L)."""

    time_s: Array
    poses: Array
    rates: Array
    actuators: Array
    loads: Array
    iterations: int


def solve(model: SymbolicContact, target: Target, intervals: int = 50, smoothing: float = 1e-4) -> Control:
    """Transcribe and solve with IPOPT. Raises RuntimeError where it does not converge."""
    grid = Collocation(intervals, 3, target.time_s[-1])
    loads_at, rz_at = CubicSpline(target.time_s, target.loads), CubicSpline(target.time_s, target.rz)
    nodes_s, points_s, points = np.linspace(0.0, grid.duration_s, intervals + 1), grid.times_s, 3 * intervals
    opti = ca.Opti()
    step = pose_steps(model.scene.sensitive_pose)  # mm, rad: one unit of each scaled variable
    step_v, step_u = 20.0 * step, 100.0 * POSE_IN_MM
    node_q, q = opti.variable(6, intervals + 1), opti.variable(6, points)
    node_v, v, u = opti.variable(6, intervals + 1), opti.variable(6, points), opti.variable(6, points)

    def scaled(matrix: ca.MX, unit: Array) -> ca.MX:
        return ca.diag(ca.DM(unit)) @ matrix

    forces, loads = acceleration_forces(model).map(points)(scaled(q, step), scaled(v, step_v), scaled(u, step_u))
    opti.subject_to(grid.derivatives(node_q, q) == 20.0 * grid.step_s * v)
    opti.subject_to(
        scaled(grid.derivatives(node_v, v), INERTIA * step_v / step_u / grid.step_s) == scaled(forces, 1.0 / step_u)
    )
    opti.subject_to(grid.jumps(node_q, q) == 0.0)
    opti.subject_to(grid.jumps(node_v, v) == 0.0)
    opti.subject_to(node_q[:, 0] == node_q[:, -1])
    opti.subject_to(node_v[:, 0] == node_v[:, -1])
    for low, high, row in zip(*(bound / step for bound in pose_bounds(model)), range(6), strict=True):
        if np.isfinite(low):
            opti.subject_to(opti.bounded(low, q[row, :], high))
    off = scaled(loads - loads_at(points_s).T, 1.0 / newton_scales(model.load_names, 25.0))
    off_rz = (step[5] * q[5, :] - rz_at(points_s)[None]) / np.radians(0.01)
    change = 100.0 * (u[:, 1:] - u[:, :-1])
    opti.minimize(0.5 * (ca.sumsqr(off) + ca.sumsqr(off_rz) + smoothing * ca.sumsqr(change)))

    # Start: in balance with the target loads at the nodes, splines between; actuators carry the contact loads.
    total = loads_at(nodes_s) @ total_selection(model.load_names, model.patch_names).T
    rest = np.zeros((intervals + 1, 6))
    rest[:, 1], rest[:, 5] = model.scene.start_pose[1], rz_at(nodes_s)
    start = press_together(model, rest, rest, total, POSE_NAMES[:5])
    targets = dict(zip(model.load_names, loads_at(nodes_s).T, strict=True))
    start, _ = settle(model, start, POSE_NAMES[:5], targets, tolerance=1.0)
    total[:, 3:] -= np.cross(start[:, :3], total[:, :3])
    motion, pushes = CubicSpline(nodes_s, start), CubicSpline(nodes_s, total)
    for at, variables in ((nodes_s, (node_q, node_v)), (points_s, (q, v))):
        opti.set_initial(variables[0], (motion(at) / step).T)
        opti.set_initial(variables[1], (motion(at, 1) / step_v).T)
    opti.set_initial(u, (pushes(points_s) / step_u).T)
    options = ipopt_options(tolerance=1e-6, max_iterations=200, mu_init=1e-3)
    opti.solver("ipopt", options | {"detect_simple_bounds": True})
    found = opti.solve()
    poses, rates, actuators = (
        np.asarray(found.value(part)).T * unit for part, unit in ((q, step), (v, step_v), (u, step_u))
    )
    return Control(points_s, poses, rates, actuators, model(poses), int(found.stats()["iter_count"]))


def forward(model: SymbolicContact, control: Control) -> Array:
    """Poses (n, 6) at the collocation points when the found actuators drive the joint, from the state at the first
    point on: CVODES, actuators as cubic splines, rz prescribed."""

    def spline(values: Array) -> ca.Function:
        return ca.interpolant("curve", "bspline", [control.time_s.tolist()], values.ravel().tolist())

    x, t = ca.MX.sym("x", 10), ca.MX.sym("t")
    flexion = spline(control.poses[:, 5])(t)
    pose, rates = ca.vertcat(x[:5], flexion), ca.vertcat(x[5:], ca.jacobian(flexion, t))
    forces, _ = acceleration_forces(model)(pose, rates, spline(control.actuators)(t))
    dae = {"x": x, "t": t, "ode": ca.vertcat(x[5:], forces[:5] / ca.DM(INERTIA[:5]))}
    options = {"abstol": 1e-7, "reltol": 1e-7, "max_num_steps": 100_000}
    integrate = ca.integrator("forward", "cvodes", dae, control.time_s[0], control.time_s[1:].tolist(), options)
    states = np.asarray(integrate(x0=np.append(control.poses[0, :5], control.rates[0, :5]))["xf"]).T
    return np.column_stack([np.vstack([control.poses[0, :5], states[:, :5]]), control.poses[:, 5]])


def main(
    surrogate: str | None = None,
    scene: str | None = None,
    intervals: int = 50,
    out: Path = Path("results/optimal_control"),
) -> None:
    """Find the actuators that carry a simulated cycle's loads, on a surrogate or on the foundation of a scene."""
    model = load_contact(surrogate, scene)
    target = simulated(model)
    control = solve(model, target, intervals)
    driven = forward(model, control)
    target_loads = CubicSpline(target.time_s, target.loads)(control.time_s)

    print(verify(model, control.poses, reference_model(model)).line)
    print(f"solved after {control.iterations} iterations; RMS differences of loads [N, N·mm]:")
    print("load    found - target  forward - found")
    for name, a, b in zip(
        model.load_names, (control.loads - target_loads).T, (model(driven) - control.loads).T, strict=True
    ):
        print(f"{name:6s} {np.sqrt(np.mean(a**2)):15.3f} {np.sqrt(np.mean(b**2)):16.3f}")

    out.mkdir(parents=True, exist_ok=True)
    write_poses(control.time_s, control.poses, out / "optimal_control.csv")
    page = new_page(11.0, 6.0)
    for k, axis in enumerate(page.subplots(2, 3).T.ravel()):
        if k < 2:
            axis.plot(control.time_s, target_loads[:, k], lw=4.0, alpha=0.25, color="black", label="target")
            axis.plot(control.time_s, control.loads[:, k], label="found")
            axis.set_ylabel(f"{model.load_names[k]} [N]")
            axis.legend()
        else:
            column = (0, 1, 4, 5)[k - 2]
            axis.plot(control.time_s, control.actuators[:, column])
            axis.set_ylabel(f"actuator {WRENCH_NAMES[column]} [{'N' if column < 3 else 'N·mm'}]")
        axis.set_xlabel("time [s]")
    save_page(page, out / "optimal_control.png")


if __name__ == "__main__":
    run_program(main)
