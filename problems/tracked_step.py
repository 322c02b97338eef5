"""A measured step tracked by a planar leg whose dynamics are closed, on `foot_on_ground` and on six smooth spheres.

    states      q: x, y, θ of the foot, leans of shank and thigh (about z) in the plane of walking [mm, rad]; rates
    controls    moments at ankle, knee, hip and the force of the trunk on the hip [N·mm, N], at the collocation points
    minimise    mean of |(q - q̂)/σ_q|² + |(F - F̂)/σ_F|² + small changes of the controls
    subject to  Σ_k m_k J_kᵀ(a_k - g) = moments, force on the hip, ground     of foot, shank, thigh (5 equations)
                F_x² + F_z² ≤ (μ·F_y)²

by direct collocation; out of the plane the foot moves as measured. Masses and lengths of shank and thigh are those of
`problems.squat`, of the model's mass; how they lean is measured, too. The spheres are those of CasADi's users
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
from problems.squat import Body

MASS_T, INERTIA, CENTRE, ANKLE = 1.2e-3, 5.0, (75.0, 5.0), (49.0, 42.0)  # t, t·mm², mm in the foot
SPHERES = np.column_stack(  # x, y, z in the foot [mm], the last two beyond the toe joint, which is locked
    [[1.9, 148.3, 133.1, 66.3, 238.8, 223.8], [-10, -10, -10, -10, -12, -12], [-3.8, -28.7, 51.6, 26.4, -17.7, 63.0]]
)
PLANE = [0, 1, 5]
SIGMA_Q = np.array([2.5, 2.5, 0.0175, 0.035, 0.035])  # [mm, rad]: of soft tissue, thighs are measured worse than shoes


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
    """At times (n,) [s]: poses (n, 6), leans of shank and thigh (n, 2), wrenches of the
    ground (n, 6), moments at ankle, knee and hip (n, 3) [N·mm]; largest |F_t|/N where N > 40 N; how it ended."""

    time_s: Array
    poses: Array
    leans: Array
    wrench: Array
    moments: Array
    cone: float
    ipopt: IpoptOutcome
    seconds: float


def leg(body: Body) -> ca.Function:
    """(q, q̇, q̈, controls (5), wrench of the ground about its origin (6)) -> what is left of the equations of motion:
    forces on the foot [N], moments of foot, shank and thigh [N·mm]."""
    q, v, a, u, wrench = (ca.SX.sym(name, rows) for name, rows in (("q", 5), ("v", 5), ("a", 5), ("u", 5), ("F", 6)))
    masses, lengths, centres, inertias = (each[:2].tolist() for each in body.segments)

    def along(turn: ca.SX, x: float, y: float) -> ca.SX:
        return ca.vertcat(ca.cos(turn) * x - ca.sin(turn) * y, ca.sin(turn) * x + ca.cos(turn) * y)

    ankle = q[:2] + along(q[2], *ANKLE)
    knee = ankle + along(q[3], 0.0, 1e3 * lengths[0])
    hip = knee + along(q[4], 0.0, 1e3 * lengths[1])
    middles = [q[:2] + along(q[2], *CENTRE), ankle + along(q[3], 0.0, 1e3 * centres[0])]
    r = ca.vertcat(*middles, knee + along(q[4], 0.0, 1e3 * centres[1]), q[2:])
    m, inertia = 1e-3 * np.array([1e3 * MASS_T, *masses]), np.array([INERTIA, *(1e3 * np.array(inertias))])  # t, t·mm²
    J = ca.jacobian(r, q)
    accelerations = J @ a + ca.jtimes(J @ v, q, v) + ca.DM([0.0, 9806.65] * 3 + [0.0] * 3)
    inertial = J.T @ (ca.DM([*np.repeat(m, 2), *inertia]) * accelerations)
    of_ground = ca.vertcat(wrench[:2], wrench[5] + q[1] * wrench[0] - q[0] * wrench[1], 0.0, 0.0)
    of_moments = ca.vertcat(0.0, 0.0, u[0], u[1] - u[0], u[2] - u[1])
    left = of_ground + of_moments + ca.jacobian(hip, q).T @ u[3:] - inertial
    return ca.Function("leg", [q, v, a, u, wrench], [left])


def track(
    contact: ca.Function, step: Step, leans: Array, body: Body, intervals: int = 30, friction: float = 0.6
) -> Tracked:
    """Track a step and leans (n, 2) of shank and thigh by a contact (pose, rates) -> wrench; ValueError if it fails."""
    grid = Collocation(intervals, 3, float(step.time_s[-1] - step.time_s[0]))
    t = step.time_s[0] + grid.times_s
    foot, loads = CubicSpline(step.time_s, step.poses), CubicSpline(step.time_s, step.wrench)
    wanted = CubicSpline(step.time_s, np.column_stack([step.poses[:, PLANE], leans]))
    nodes = step.time_s[0] + np.linspace(0.0, grid.duration_s, intervals + 1)
    opti, n = ca.Opti(), len(t)
    scale, scale_v = (ca.diag(ca.DM(s)) for s in ([1.0, 1.0, 0.04, 0.04, 0.04], [50.0, 50.0, 2.0, 2.0, 2.0]))
    scale_u = ca.diag(ca.DM([1e4, 1e4, 1e4, 100.0, 100.0]))
    node_q, q, node_v, v = (opti.variable(5, m) for m in (intervals + 1, n, intervals + 1, n))
    u, height = opti.variable(5, n), opti.variable()
    pose, rates = ca.MX(foot(t).T), ca.MX(foot(t, 1).T)
    pose[PLANE, :], rates[PLANE, :] = (scale @ q)[:3, :], (scale_v @ v)[:3, :]
    lifted = pose + ca.vertcat(ca.MX.zeros(1, n), ca.repmat(height, 1, n), ca.MX.zeros(4, n))
    F, a = contact.map(n)(lifted, rates), scale_v @ grid.derivatives(node_v, v) / grid.step_s
    on_lifted = ca.vertcat(F[:5, :], F[5, :] + height * F[0, :])  # about the ground's origin, as the leg stands on it
    left = leg(body).map(n)(scale @ q, scale_v @ v, a, scale_u @ u, on_lifted)
    opti.subject_to(ca.vec(ca.diag(ca.DM([0.01, 0.01, 1e-4, 1e-4, 1e-4])) @ left) == 0.0)
    opti.subject_to(scale @ grid.derivatives(node_q, q) == grid.step_s * scale_v @ v)
    opti.subject_to(grid.jumps(node_q, q) == 0.0)
    opti.subject_to(grid.jumps(node_v, v) == 0.0)
    opti.subject_to(opti.bounded(-40.0, height, 40.0))
    opti.subject_to((F[0, :] ** 2 + F[2, :] ** 2 - (friction * F[1, :]) ** 2).T / 1e4 <= 1e-4)
    off_q = ca.diag(ca.DM(1.0 / SIGMA_Q)) @ (scale @ q - wanted(t).T)
    off_F = (F[:2, :] - loads(t).T[:2]) / 10.0
    change = u[:, 1:] - u[:, :-1]
    opti.minimize((ca.sumsqr(off_q) + ca.sumsqr(off_F) + 0.1 * ca.sumsqr(change)) / n + 1e-4 * height**2)

    for at, of_q, of_v in ((nodes, node_q, node_v), (t, q, v)):
        opti.set_initial(of_q, ca.inv(scale) @ ca.DM(wanted(at).T))
        opti.set_initial(of_v, ca.inv(scale_v) @ ca.DM(wanted(at, 1).T))
    opti.set_initial(u[3:, :], -0.01 * loads(t).T[:2])
    opti.solver("ipopt", ipopt_options(tolerance=1e-4, max_iterations=600) | {"detect_simple_bounds": True})
    began = time.perf_counter()
    try:
        found = opti.solve()
    except RuntimeError as error:
        raise ValueError(f"not solved ({opti.stats()['return_status']}), expected a step in mm, rad and N") from error
    took, wrench = time.perf_counter() - began, np.asarray(found.value(F)).T
    on = wrench[:, 1] > 40.0
    cone = float((np.hypot(wrench[on, 0], wrench[on, 2]) / wrench[on, 1]).max())
    curves = (pose, (scale @ q)[3:, :], (scale_u @ u)[:3, :])
    moved, leans, moments = (np.asarray(found.value(each)).T for each in curves)
    ended = IpoptOutcome(str(found.stats()["return_status"]), int(found.stats()["iter_count"]))
    return Tracked(t, moved, leans, wrench, moments, cone, ended, took)


def read_leans(path: Path, times_s: Array, side: str = "r") -> Array:
    """Leans (n, 2) [rad] of shank and thigh from OpenSim's coordinates of a walking trial, in its names and degrees."""
    table = cc.opensim.read_opensim_table(path)
    names = ("pelvis_tilt", f"hip_flex_{side}", f"knee_flex_{side}")
    tilt, hip, knee = (np.interp(times_s, table.columns["time"], np.radians(table.column(name))) for name in names)
    return np.column_stack([tilt + hip - knee, tilt + hip])


def main(
    step: Path = Path("../shared/data/jam_knee/steps/right_step.csv"),
    motion: Path = Path("../shared/data/jam_knee/walking/overground_17_ik.mot"),
    scene: str = "foot_on_ground",
    mass_kg: float = 62.0,
    height_m: float = 1.70,
    intervals: int = 30,
    out: Path = Path("results/tracked_step"),
) -> None:
    """Fit the contact to a right foot's step (CSV), then track it, and a leg's motion (.mot), with it and spheres."""
    measured, model = read_step(step, every=3), cc.foundation(scene)
    found, leans = fit(model, measured), read_leans(motion, measured.time_s)
    pose, rates = ca.MX.sym("pose", 6), ca.MX.sym("rates", 6)
    p = ca.DM([found.parameters[name] for name in PARAMETERS])
    sole = ca.Function("sole", [pose, rates], [ground_wrench(model)(pose, rates, p)])
    corrected = Step(measured.time_s, found.poses, measured.wrench)
    wanted = np.column_stack([found.poses[:, PLANE], leans])
    print("contact   vertical, fore-aft [N]  foot [mm, °], leg [°] RMS  largest |F_t|/N  iterations  seconds", end="")
    print("  largest moment at ankle, knee, hip [N·m]")
    page = new_page(12.0, 4.0)
    axes = page.subplots(1, 3)
    for name, contact, style in (("sole", sole, SURROGATE), ("spheres", spheres(), FOUNDATION)):
        done = track(contact, corrected, leans, Body(mass_kg, height_m), intervals)
        off = done.wrench[:, :2] - CubicSpline(measured.time_s, measured.wrench)(done.time_s)[:, :2]
        moved = np.column_stack([done.poses[:, PLANE], done.leans]) - CubicSpline(measured.time_s, wanted)(done.time_s)
        turned = np.degrees(moved[:, 2:])
        apart = np.column_stack([off[:, ::-1], np.hypot(*moved.T[:2]), turned[:, 0], np.hypot(*turned.T[1:])])
        rms = np.sqrt(np.mean(apart**2, axis=0))
        print("{:8s} {:9.1f} {:12.1f} {:9.2f} {:8.2f} {:8.2f}".format(name, *rms), end="")
        print(f" {done.cone:14.3f} {done.ipopt.iterations:11d} {done.seconds:8.1f}", end="  ")
        print(" ".join(f"{1e-3 * np.abs(moment).max():.0f}" for moment in done.moments.T))
        for axis, k, label in zip(axes, (1, 0), ("vertical [N]", "fore-aft [N]"), strict=False):
            axis.plot(measured.time_s, measured.wrench[:, k], **TARGET)
            axis.plot(done.time_s, done.wrench[:, k], label=name, **style)
            axis.set(xlabel="time [s]", ylabel=label)
        for joint, dashes, moment in zip(("ankle", "knee", "hip"), ("-", "--", ":"), done.moments.T, strict=True):
            axes[2].plot(done.time_s, 1e-3 * moment, **style | {"label": f"{joint}, {name}", "ls": dashes})
    axes[2].set(xlabel="time [s]", ylabel="moments [N·m]")
    for axis in axes[[0, 2]]:
        axis.legend()
    out.mkdir(parents=True, exist_ok=True)
    save_page(page, out / "tracked_step.png")


if __name__ == "__main__":
    run_program(main)
