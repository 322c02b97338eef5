"""Optimal control of a joint: find the actuator loads whose motion carries wanted contact loads, all six degrees free.

Direct collocation (Radau or Legendre points) over one cycle of N intervals, all in one IPOPT problem with exact
Hessian. With pose q (6), rates v (6) and actuator wrenches u (6) about the moving origin at every collocation point,

    q̇ = v,    M·v̇ = Q(q; u) - Q(q; W(q)) - k·(q - q_rest) - c·v

(as in `problems.knee_simulator`, with flexion now moving as freely as the rest), find

    min ½ Σ |(loads(q) - wanted)/L|² + ½ Σ ((rz - wanted rz)/δ)² + ½ steadiness·Σ |Δu/L|²    [N²]

over the collocation points: L = 1 for forces and 25 mm for torques, δ = 0.01 degrees (contact does not hold flexion,
so wanted loads alone leave it open), Δu the change from point to point. Poses stay in the learned range; the cycle is
periodic by choice. Poses, rates and dynamics are scaled to like size.

The wanted loads of the built-in example are those that a forward simulation of the knee simulator carries, so the
answer is known: the simulator's motion, and its applied loads as controls.

Run ``python -m problems.optimal_control --help``.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer
from scipy.interpolate import CubicSpline

from casadi_contact.conventions import Array, is_force, pose_index
from casadi_contact.files import writable_folder
from casadi_contact.structures import Surrogate, load_surrogate
from problems import static_equilibrium
from problems.command import run_command
from problems.foundation_callback import total_selection
from problems.joint_mechanics import IN_MM, LEVER_MM, STEPS, SURROGATE_OPTIONS, generalised_forces
from problems.learned_range import middle_pose, pose_bounds
from problems.simulator_rig import Rig
from problems.wanted_cycle import WantedCycle, simulated_cycle

SCHEMES = ("radau", "legendre")
FLEXION_RAD = np.radians(0.01)  # flexion off by this weighs as much as a force off by 1 N
_FLEXION_INERTIA = 20.0  # t·mm², that is 0.02 kg·m², as about the other axes
_FLEXION_DAMPING = 1000.0  # N·mm·s/rad
_RATES = 20.0 * STEPS  # [mm/s, rad/s] like in effect
_LOAD_SCALE_N = 100.0  # of actuator loads (torques over 25 mm) and dynamics
_RZ = pose_index("rz")


@dataclass(frozen=True)
class OptimalControl:
    """A problem that can be looked at unsolved: CasADi's nlp and bounds, collocation times, and what it came from.

    times (points,) are those of the collocation points; unpack: x -> poses (6, points), rates (6, points), actuator
    wrenches (6, points) and poses at the ends of intervals (6, intervals + 1), in physical units.
    """

    surrogate: Surrogate
    wanted: WantedCycle
    times: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    unpack: ca.Function
    intervals: int
    degree: int


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


def _point_function(surrogate: Surrogate, rig: Rig) -> ca.Function:
    """(scaled q, v, u, wanted loads, wanted rz) -> (acceleration forces (6) [N], tracking residuals (L + 1) [N])."""
    q, v, u = (ca.MX.sym(name, 6) for name in ("q", "v", "u"))
    wanted, rz = ca.MX.sym("wanted", len(surrogate.load_names)), ca.MX.sym("rz")
    pose = q * STEPS
    loads = surrogate.function(**SURROGATE_OPTIONS)(pose)
    contact = ca.mtimes(ca.DM(total_selection(surrogate.load_names)), loads)
    actuators = u * (_LOAD_SCALE_N * IN_MM)
    stiffness, rest = np.append(rig.stiffness, 0.0), np.append(rig.rest_mm_rad, 0.0)
    damping = np.append(rig.damping, _FLEXION_DAMPING)
    forces = (
        generalised_forces(pose, actuators, about="moving")
        - generalised_forces(pose, contact)
        - ca.DM(stiffness) * (pose - ca.DM(rest))
        - ca.DM(damping) * (v * _RATES)
    )
    levers = np.array([1.0 if is_force(name) else LEVER_MM for name in surrogate.load_names])
    off = ca.vertcat((loads - wanted) / ca.DM(levers), (pose[_RZ] - rz) / FLEXION_RAD)
    return ca.Function("point", [q, v, u, wanted, rz], [forces / ca.DM(IN_MM), off])


def build(
    surrogate: Surrogate,
    wanted: WantedCycle,
    *,
    rig: Rig | None = None,
    intervals: int = 50,
    degree: int = 3,
    scheme: str = "radau",
    periodic: bool = True,
    steadiness: float = 1e-4,
) -> OptimalControl:
    """Transcribe the cycle. Raises ValueError for an unknown scheme, too few intervals or a negative steadiness."""
    rig = Rig() if rig is None else rig
    if scheme not in SCHEMES:
        raise ValueError(f"scheme is {scheme!r}, expected one of {', '.join(SCHEMES)}")
    if intervals < 2 or not 1 <= degree <= 9 or not steadiness >= 0.0:
        raise ValueError(
            f"intervals {intervals}, degree {degree}, steadiness {steadiness}: expected >= 2, 1 to 9, and >= 0"
        )
    if wanted.loads.shape != (len(wanted.time_s), len(surrogate.load_names)):
        raise ValueError(
            f"wanted loads have shape {wanted.loads.shape}, expected "
            f"({len(wanted.time_s)}, {len(surrogate.load_names)}): {' '.join(surrogate.load_names)}"
        )
    taus = ca.collocation_points(degree, scheme)
    slopes, ends, _ = (np.asarray(part) for part in ca.collocation_coeff(taus))
    step = (wanted.time_s[-1] - wanted.time_s[0]) / intervals
    times = ((np.arange(intervals)[:, None] + np.asarray(taus)) * step).ravel()
    points = intervals * degree
    loads, rz = wanted.at(wanted.time_s[0] + times)

    nodes_q, nodes_v = ca.MX.sym("node_q", 6, intervals + 1), ca.MX.sym("node_v", 6, intervals + 1)
    q, v, u = (ca.MX.sym(name, 6, points) for name in ("q", "v", "u"))
    forces, off = _point_function(surrogate, rig).map(points)(q, v, u, ca.DM(loads.T), ca.DM(rz[None]))
    inertia = np.append(rig.inertia, _FLEXION_INERTIA)
    # Each interval's polynomial through its node and collocation points: slopes there, and the value at its end.
    to_steps = ca.DM(_RATES / STEPS * step)
    to_newtons = ca.DM(inertia * _RATES / IN_MM / step)
    defects = []
    for k in range(intervals):
        here = slice(k * degree, (k + 1) * degree)
        stacked_q, stacked_v = ca.horzcat(nodes_q[:, k], q[:, here]), ca.horzcat(nodes_v[:, k], v[:, here])
        defects += [
            ca.vec(ca.mtimes(stacked_q, slopes) - ca.repmat(to_steps, 1, degree) * v[:, here]),
            ca.vec(ca.repmat(to_newtons, 1, degree) * ca.mtimes(stacked_v, slopes) - forces[:, here]) / _LOAD_SCALE_N,
            ca.mtimes(stacked_q, ends) - nodes_q[:, k + 1],
            ca.mtimes(stacked_v, ends) - nodes_v[:, k + 1],
        ]
    if periodic:
        defects += [nodes_q[:, 0] - nodes_q[:, -1], nodes_v[:, 0] - nodes_v[:, -1]]
    changes = _LOAD_SCALE_N * (u[:, 1:] - u[:, :-1])
    x = ca.vertcat(*(ca.vec(part) for part in (nodes_q, nodes_v, q, v, u)))
    low, high = (bound / STEPS for bound in pose_bounds(surrogate))
    free_rates, free_loads = np.full(6 * points, np.inf), np.full(6 * points, np.inf)
    node_rates = np.full(6 * (intervals + 1), np.inf)
    parts = (np.tile(low, intervals + 1), -node_rates, np.tile(low, points), -free_rates, -free_loads)
    tops = (np.tile(high, intervals + 1), node_rates, np.tile(high, points), free_rates, free_loads)
    physical = [ca.DM(scale) for scale in (STEPS, _RATES, _LOAD_SCALE_N * IN_MM)]
    return OptimalControl(
        surrogate=surrogate,
        wanted=wanted,
        times=times,
        nlp={"x": x, "f": 0.5 * (ca.sumsqr(off) + steadiness * ca.sumsqr(changes)), "g": ca.vertcat(*defects)},
        lower=np.concatenate(parts),
        upper=np.concatenate(tops),
        unpack=ca.Function(
            "unpack",
            [x],
            [
                *(ca.repmat(scale, 1, points) * part for scale, part in zip(physical, (q, v, u), strict=True)),
                ca.repmat(physical[0], 1, intervals + 1) * nodes_q,
            ],
        ),
        intervals=intervals,
        degree=degree,
    )


def start_values(problem: OptimalControl) -> Array:
    """x at poses in static equilibrium with the wanted loads at the ends of intervals, flexion as wanted, and a spline
    between them; actuators at the wanted loads, as if nothing else acted."""
    surrogate, wanted = problem.surrogate, problem.wanted
    node_times = np.linspace(0.0, wanted.time_s[-1] - wanted.time_s[0], problem.intervals + 1)
    loads, rz = wanted.at(wanted.time_s[0] + node_times)
    rest = np.tile(middle_pose(surrogate), (len(node_times), 1))
    rest[:, _RZ] = rz
    total = loads @ total_selection(surrogate.load_names).T
    poses = static_equilibrium.solve(static_equilibrium.build(surrogate, total, rest=rest)).poses
    total[:, 3:] -= np.cross(poses[:, :3], total[:, :3])  # about the moving origin
    motion = CubicSpline(node_times, poses)
    actuators = CubicSpline(node_times, total)(problem.times) / (_LOAD_SCALE_N * IN_MM)
    parts = [part for at in (node_times, problem.times) for part in (motion(at) / STEPS, motion(at, 1) / _RATES)]
    return np.clip(np.concatenate([part.ravel() for part in (*parts, actuators)]), problem.lower, problem.upper)


def solve(
    problem: OptimalControl, start: Array | None = None, max_iterations: int = 200, print_level: int = 0
) -> ControlResult:
    """Solve with IPOPT from x, `start_values` if left out. Never raises where it does not converge: it is reported."""
    began = time.perf_counter()
    options: dict[str, Any] = {
        "ipopt": {
            "print_level": print_level,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": 1e-6,
            "hessian_approximation": "exact",
            "mu_init": 1e-3,  # the start is near the solution
        },
        "print_time": False,
    }
    solver = ca.nlpsol("optimal_control", "ipopt", problem.nlp, options)
    x0 = start_values(problem) if start is None else start
    answer = solver(x0=x0, lbx=problem.lower, ubx=problem.upper, lbg=0.0, ubg=0.0)
    stats = solver.stats()
    poses, rates, actuators, node_poses = (np.asarray(part).T for part in problem.unpack(answer["x"]))
    loads = problem.surrogate(poses)
    wanted, rz = problem.wanted.at(problem.wanted.time_s[0] + problem.times)
    status = str(stats["return_status"])
    return ControlResult(
        poses=poses,
        rates=rates,
        actuators=actuators,
        node_poses=node_poses,
        loads=loads,
        load_error=loads - wanted,
        flexion_error_deg=np.degrees(poses[:, _RZ] - rz),
        converged=status in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        ipopt_status=status,
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - began,
    )


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    intervals: Annotated[int, typer.Option(help="collocation intervals over the cycle")] = 50,
    degree: Annotated[int, typer.Option(help="collocation points of each interval")] = 3,
    scheme: Annotated[str, typer.Option(help="radau or legendre")] = "radau",
    periodic: Annotated[bool, typer.Option(help="end where the cycle began")] = True,
    steadiness: Annotated[float, typer.Option(help="weight of the actuators' change from point to point")] = 1e-4,
    out: Annotated[Path, typer.Option(help="folder for optimal_control.csv, .png, .json")] = Path("results"),
) -> None:
    """Find the actuator loads and the motion that carry the knee simulator's contact loads; check them on the EF."""
    from problems.optimal_control_report import report  # draws with matplotlib: not needed to solve

    writable_folder(out)
    model = load_surrogate(surrogate)
    wanted = simulated_cycle(model)
    problem = build(
        model,
        wanted,
        intervals=intervals,
        degree=degree,
        scheme=scheme,
        periodic=periodic,
        steadiness=steadiness,
    )
    result = solve(problem)
    report(problem, result, out)
    if not result.converged:
        print(f"optimal_control: IPOPT stopped: {result.ipopt_status}", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; not converged is exit status 2."""
    run_command(app, "optimal_control")


if __name__ == "__main__":
    main()
