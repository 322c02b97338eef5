"""A measured step tracked by a foot whose dynamics are closed, on `foot_on_ground` and on six smooth spheres.

    states      x, y, θ of the foot in the plane of walking [mm, rad] and their rates; else it moves as measured
    controls    force and moment of the leg on the ankle [N, N·mm], at the collocation points
    minimise    mean of |(q - q̂)/σ_q|² + |(F - F̂)/σ_F|² + small changes of the controls
    subject to  m·a = F + F_ankle + m·g,   I·θ̈ = moments of the ground and the ankle about the centre of mass
                F_x² + F_z² ≤ (μ·F_y)²

by direct collocation: the foot of a leg whose rest acts at the ankle. The spheres are those of CasADi's users
(Serrancolí et al., IEEE Trans Neural Syst Rehabil Eng 27 (2019) 1492-1500, OpenSim's SmoothSphereHalfSpaceForce), with
the places and numbers of Falisse et al., J R Soc Interface 16 (2019) 20190402. Each contact gets a height of its own,
since neither knows how thick this shoe is.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

import casadi_contact as cc
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.networks.frames import rotation
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.pictures.page import FOUNDATION, SURROGATE, TARGET, new_page, save_page
from problems.collocation import Collocation
from problems.ground_contact import PARAMETERS, Step, fit, ground_wrench, read_step

MASS_T, INERTIA, CENTRE, ANKLE = 1.2e-3, 5.0, (75.0, 5.0), (49.0, 42.0)  # t, t·mm², mm in the foot
SPHERES = np.array(  # in the foot [mm], the last two beyond the toe joint, which is locked
    [
        [1.9, -10, -3.8],
        [148.3, -10, -28.7],
        [133.1, -10, 51.6],
        [66.3, -10, 26.4],
        [238.8, -12, -17.7],
        [223.8, -12, 63.0],
    ]
)
PLANE, OTHERS = [0, 1, 5], [2, 3, 4]


def spheres(
    radius: float = 0.032, stiffness: float = 1e6, c: float = 2.0, friction: float = 0.8, viscous: float = 0.5
) -> ca.Function:
    """(pose of the foot (6), rates (6)) -> force of the ground on six spheres and its moment about the origin (6)
    [N, N·mm]: f = 4/3·k√(Rk)·(x² + ε)^¾·(1 + tanh 300x)/2, times (1 + 3/2·cẋ)·(1 + tanh 50(ẋ + 2/3c))/2, in m and s."""
    pose, rates, wrench = ca.SX.sym("pose", 6), ca.SX.sym("rates", 6), ca.SX.zeros(6)
    k, small, slow = 0.5 * stiffness ** (2.0 / 3.0), 1e-5, 0.2
    for centre in SPHERES:
        at = 1e-3 * (pose[:3] + rotation(pose[3:]) @ ca.DM(centre))
        speed = ca.jtimes(at, pose, rates)
        x, v = radius - at[1], -speed[1]
        normal = 4.0 / 3.0 * k * np.sqrt(radius * k) * (x**2 + small) ** 0.75 * (0.5 + 0.5 * ca.tanh(300.0 * x))
        normal *= (1.0 + 1.5 * c * v) * (0.5 + 0.5 * ca.tanh(50.0 * (v + 2.0 / (3.0 * c))))
        slip = ca.sqrt(speed[0] ** 2 + speed[2] ** 2 + small)
        drag = normal * (friction * ca.fmin(slip / slow, 1.0) + viscous * slip) / slip
        force = ca.vertcat(-drag * speed[0], normal, -drag * speed[2])
        wrench += ca.vertcat(force, ca.cross(1e3 * at - ca.vertcat(0.0, 1e3 * at[1], 0.0), force))
    return ca.Function("spheres", [pose, rates], [wrench])


@dataclass(frozen=True)
class Tracked:
    """At times (n,) [s]: poses (n, 6), wrenches of the ground (n, 6); largest |F_t|/N where N > 40 N; how it ended."""

    time_s: Array
    poses: Array
    wrench: Array
    cone: float
    ipopt: IpoptOutcome
    seconds: float


def track(contact: ca.Function, step: Step, intervals: int = 30, friction: float = 0.6) -> Tracked:
    """Track a step with a contact (pose, rates) -> wrench. Raises ValueError where IPOPT finds no solution."""
    grid = Collocation(intervals, 3, float(step.time_s[-1] - step.time_s[0]))
    t = step.time_s[0] + grid.times_s
    wanted, loads = CubicSpline(step.time_s, step.poses), CubicSpline(step.time_s, step.wrench)
    nodes = step.time_s[0] + np.linspace(0.0, grid.duration_s, intervals + 1)
    opti, n = ca.Opti(), len(t)
    scale, scale_v, scale_u = (ca.diag(ca.DM(s)) for s in ([1.0, 1.0, 0.04], [50.0, 50.0, 2.0], [100.0, 100.0, 1e4]))
    node_q, q, node_v, v = (opti.variable(3, m) for m in (intervals + 1, n, intervals + 1, n))
    u, height = opti.variable(3, n), opti.variable()
    pose, rates = ca.MX(wanted(t).T), ca.MX(wanted(t, 1).T)
    pose[PLANE, :], rates[PLANE, :] = scale @ q, scale_v @ v
    lifted = pose + ca.vertcat(ca.MX.zeros(1, n), ca.repmat(height, 1, n), ca.MX.zeros(4, n))
    F = contact.map(n)(lifted, rates)
    push = scale_u @ u

    c, s = ca.cos(pose[5, :]), ca.sin(pose[5, :])
    arm, ankle = ([c * p[0] - s * p[1], s * p[0] + c * p[1]] for p in (CENTRE, ANKLE))
    a = scale_v @ grid.derivatives(node_v, v) / grid.step_s
    turn, w = a[2, :], rates[5, :]
    acceleration = ca.vertcat(
        a[0, :] - turn * arm[1] - w**2 * arm[0], a[1, :] + turn * arm[0] - w**2 * arm[1] + 9806.65
    )
    about = F[5, :] - (pose[0, :] + arm[0]) * F[1, :] + (lifted[1, :] + arm[1]) * F[0, :]
    about += push[2, :] + (ankle[0] - arm[0]) * push[1, :] - (ankle[1] - arm[1]) * push[0, :]
    opti.subject_to(ca.vec(F[:2, :] + push[:2, :] - MASS_T * acceleration) / 100.0 == 0.0)
    opti.subject_to((about - INERTIA * turn).T / 1e4 == 0.0)
    opti.subject_to(scale @ grid.derivatives(node_q, q) == grid.step_s * scale_v @ v)
    opti.subject_to(grid.jumps(node_q, q) == 0.0)
    opti.subject_to(grid.jumps(node_v, v) == 0.0)
    opti.subject_to(opti.bounded(-40.0, height, 40.0))
    opti.subject_to((F[0, :] ** 2 + F[2, :] ** 2 - (friction * F[1, :]) ** 2).T / 1e4 <= 1e-4)
    off_q = ca.diag(ca.DM([1 / 2.5, 1 / 2.5, 1 / 0.0175])) @ (pose - wanted(t).T)[PLANE, :]
    off_F = (F[:2, :] - loads(t).T[:2]) / 10.0
    change = u[:, 1:] - u[:, :-1]
    opti.minimize((ca.sumsqr(off_q) + ca.sumsqr(off_F) + 0.1 * ca.sumsqr(change)) / n + 1e-4 * height**2)

    for at, variable, unit, order in (
        (nodes, node_q, scale, 0),
        (t, q, scale, 0),
        (nodes, node_v, scale_v, 1),
        (t, v, scale_v, 1),
    ):
        opti.set_initial(variable, ca.inv(unit) @ ca.DM(wanted(at, order).T[PLANE]))
    opti.set_initial(u, ca.inv(scale_u) @ ca.DM(-loads(t).T[:3] * [[1.0], [1.0], [0.0]]))
    opti.solver("ipopt", ipopt_options(tolerance=1e-4, max_iterations=600) | {"detect_simple_bounds": True})
    began = time.perf_counter()
    try:
        found = opti.solve()
    except RuntimeError as error:
        raise ValueError(f"not solved ({opti.stats()['return_status']}), expected a step in mm, rad and N") from error
    took, wrench = time.perf_counter() - began, np.asarray(found.value(F)).T
    on = wrench[:, 1] > 40.0
    cone = float((np.hypot(wrench[on, 0], wrench[on, 2]) / wrench[on, 1]).max())
    ended = IpoptOutcome(str(found.stats()["return_status"]), int(found.stats()["iter_count"]))
    return Tracked(t, np.asarray(found.value(pose)).T, wrench, cone, ended, took)


def main(
    step: Path = Path("../shared/data/jam_knee/steps/right_step.csv"),
    scene: str = "foot_on_ground",
    intervals: int = 30,
    out: Path = Path("results/tracked_step"),
) -> None:
    """Fit the contact to a right foot's step (CSV), then track it with that contact and with six spheres."""
    measured, model = read_step(step, every=3), cc.foundation(scene)
    found = fit(model, measured)
    pose, rates = ca.MX.sym("pose", 6), ca.MX.sym("rates", 6)
    p = ca.DM([found.parameters[name] for name in PARAMETERS])
    sole = ca.Function("sole", [pose, rates], [ground_wrench(model)(pose, rates, p)])
    corrected = Step(measured.time_s, found.poses, measured.wrench)
    print("contact   vertical, fore-aft [N]  foot [mm, °] RMS  largest |F_t|/N  iterations  seconds")
    page = new_page(9.0, 4.0)
    axes = page.subplots(1, 2)
    for name, contact, style in (("sole", sole, SURROGATE), ("spheres", spheres(), FOUNDATION)):
        done = track(contact, corrected, intervals)
        off = done.wrench[:, :2] - CubicSpline(measured.time_s, measured.wrench)(done.time_s)[:, :2]
        moved = (done.poses - CubicSpline(measured.time_s, found.poses)(done.time_s))[:, PLANE]
        apart = np.column_stack([off, np.linalg.norm(moved[:, :2], axis=1), np.degrees(moved[:, 2])])
        rms = np.sqrt(np.mean(apart**2, axis=0))[[1, 0, 2, 3]]
        print("{:8s} {:9.1f} {:12.1f} {:9.2f} {:8.2f}".format(name, *rms), end="")
        print(f" {done.cone:14.3f} {done.ipopt.iterations:11d} {done.seconds:8.1f}")
        for axis, k, label in zip(axes, (1, 0), ("vertical [N]", "fore-aft [N]"), strict=True):
            axis.plot(measured.time_s, measured.wrench[:, k], **TARGET)
            axis.plot(done.time_s, done.wrench[:, k], label=name, **style)
            axis.set(xlabel="time [s]", ylabel=label)
    axes[0].legend()
    out.mkdir(parents=True, exist_ok=True)
    save_page(page, out / "tracked_step.png")


if __name__ == "__main__":
    run_program(main)
