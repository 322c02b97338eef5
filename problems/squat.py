"""A squat of a planar leg by direct collocation: least muscle activation against the medial contact force of the knee.

    states      leans φ of shank, thigh, trunk from the vertical [rad], and their rates
    controls    activations a (10), and the knee's pose tx, ty, rx, which contact and muscles balance
    minimise    mean of [ mean_m a_m² + w·(F_med/weight)² ] + 1e-3·Σ (change of a_m from point to point)²
    subject to  Σ_j c_ij cos(φ_i - φ_j) φ̈_j + c_ij sin(φ_i - φ_j) φ̇_j² - G_i sin φ_i = Q_i        [N·m]
                Σ_k m_k (a_k - g) = muscles + contact - k·tx        across the knee, along x, y of the insert [N]
                contact about x + frontal arms·F = -lever·(vertical ground force)        [N·m]
                centre of pressure under the foot, knee flexion a cosine of time, at rest at both ends

with Q = (M_ankle + M_knee, -M_knee - M_hip, M_hip), c_ij = Σ_k m_k a_ki a_kj (+ I_i), G_i = g Σ_k m_k a_ki and a_ki how
far along segment i the mass of segment k lies. k is the knee simulator's spring; the lever is how far medially of the
knee the ground force passes, which a planar leg cannot know. The foot stays flat.

Segments after Winter, Biomechanics and Motor Control of Human Movement. Muscle groups with constant arms after
Gerritsen et al., Motor Control 2 (1998) 206-220; hamstrings and gastrocnemius divided into a medial and a lateral part
by the forces of Arnold et al., Ann Biomed Eng 38 (2010) 269-279. The patellar tendon pulls forward of the shank by 20°
in extension and along it at 75° of flexion, about as in Herzog and Read, J Anat 182 (1993) 213-230.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import numbers, run_program
from casadi_contact.optimisation.ipopt import ipopt_options
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.optimisation.knee import SIDES, check_knee
from casadi_contact.optimisation.muscle import MuscleParameters, rigid_tendon_forces
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.starts import KNEE_STEPS, middle_pose, settle_in_range
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.columns import write_columns
from problems.collocation import Collocation
from problems.knee_simulator import Rig

# Greatest force [N], optimal fibre, tendon, length at zero angles [m]; arms [m]: hip flexion, knee extension,
# dorsiflexion, adduction of the femur; and along which line it pulls where it crosses the knee.
MUSCLES = {
    "iliopsoas": (1500.0, 0.102, 0.142, 0.248, 0.050, 0.0, 0.0, 0.0, ""),
    "glutei": (3000.0, 0.200, 0.157, 0.271, -0.062, 0.0, 0.0, 0.0, ""),
    "medial hamstrings": (3000.0 * 1460 / 2160, 0.104, 0.334, 0.383, -0.072, -0.034, 0.0, 0.020, "thigh"),
    "biceps femoris": (3000.0 * 700 / 2160, 0.104, 0.334, 0.383, -0.072, -0.034, 0.0, -0.030, "thigh"),
    "rectus femoris": (1200.0, 0.081, 0.398, 0.474, 0.034, 0.050, 0.0, 0.0, "patellar tendon"),
    "vasti": (7000.0, 0.093, 0.223, 0.271, 0.0, 0.042, 0.0, -0.006, "patellar tendon"),
    "medial gastrocnemius": (3000.0 * 1310 / 1920, 0.055, 0.420, 0.487, 0.0, -0.020, -0.053, 0.020, "shank"),
    "lateral gastrocnemius": (3000.0 * 610 / 1920, 0.055, 0.420, 0.487, 0.0, -0.020, -0.053, -0.020, "shank"),
    "soleus": (4000.0, 0.055, 0.245, 0.284, 0.0, 0.0, -0.053, 0.0, ""),
    "tibialis anterior": (2500.0, 0.082, 0.317, 0.381, 0.0, 0.0, 0.037, 0.0, ""),
}
FORCE_N, FIBRE_M, TENDON_M, LENGTH_M, HIP_M, KNEE_M, ANKLE_M, FRONTAL_M = np.array(
    [row[:8] for row in MUSCLES.values()]
).T
GROUPS = MuscleParameters(tuple(MUSCLES), FORCE_N, FIBRE_M, TENDON_M, np.zeros(len(MUSCLES)))
GRAVITY = 9.81
FREE = ("tx", "ty", "rx")  # of the knee's pose; tz and ry are 0, rz is -flexion


@dataclass(frozen=True)
class Body:
    """One leg under half of the trunk. Arrays (3,) of shank, thigh, trunk; each centre of mass from the lower end."""

    mass_kg: float = 75.0
    height_m: float = 1.75
    lever_mm: float = 20.0
    heel_m: float = -0.05
    toe_m: float = 0.15
    ankle_height_m: float = 0.07

    @property
    def segments(self) -> tuple[Array, Array, Array, Array]:
        """Masses [kg], lengths [m], places of the centres of mass [m], moments of inertia about these [kg·m²]."""
        mass = self.mass_kg * np.array([0.0465, 0.100, 0.5 * 0.678])
        size = self.height_m * np.array([0.246, 0.245, 0.288])
        return mass, size, size * np.array([0.567, 0.567, 0.626]), mass * (size * np.array([0.302, 0.323, 0.496])) ** 2


def muscle_forces(phi: ca.SX, rates: ca.SX, a: ca.SX) -> ca.SX:
    """Forces along rigid tendons (10) [N]: length = length at zero angles - arms·angles."""
    to_angles = np.array([[0.0, -1.0, 1.0], [-1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # hip flexion, knee extension, ankle
    arms = ca.DM(np.column_stack([HIP_M, KNEE_M, ANKLE_M]) @ to_angles)
    active, passive, _ = rigid_tendon_forces(GROUPS, ca.DM(LENGTH_M) - arms @ phi, -(arms @ rates), ca)
    return a * active + passive


def leg(body: Body) -> ca.Function:
    """(φ, φ̇, φ̈, a, pose of the knee (6), wrench on the insert (6)) -> what is left of the equations of motion (3)
    [N·m], of the forces (2) [N] and the moment about x (1) [N·m] across the knee, and the room of the centre of
    pressure behind and ahead, times the ground force (2) [N·m]."""
    sizes = {"phi": 3, "rates": 3, "bend": 3, "a": 10, "pose": 6, "wrench": 6}
    phi, rates, bend, a, pose, wrench = given = [ca.SX.sym(name, rows) for name, rows in sizes.items()]
    (m, lengths, centres, inertias), forces = body.segments, muscle_forces(phi, rates, a)
    hip, knee, ankle = (ca.dot(ca.DM(arms), forces) for arms in (HIP_M, KNEE_M, ANKLE_M))
    contact = generalised_forces(pose, wrench)  # on the insert
    knee = -knee + 1e-3 * contact[5]
    Q = ca.vertcat(ankle + knee, -knee - hip, hip)
    along = np.tril(np.tile(lengths, (3, 1)), -1) + np.diag(centres)  # a_ki
    c = ca.DM(along.T @ np.diag(m) @ along + np.diag(inertias))
    apart = ca.repmat(phi, 1, 3) - ca.repmat(phi.T, 3, 1)
    motion = (c * ca.cos(apart)) @ bend + (c * ca.sin(apart)) @ rates**2
    motion -= GRAVITY * ca.DM(along.T @ m) * ca.sin(phi) + Q

    forward, upward = ca.cos(phi) * bend - ca.sin(phi) * rates**2, -ca.sin(phi) * bend - ca.cos(phi) * rates**2
    push = ca.DM(m) * ca.horzcat(ca.DM(along) @ forward, ca.DM(along) @ upward + GRAVITY)  # m_k (a_k - g)
    ground, above, s, co = ca.sum1(push).T, ca.sum1(push[1:, :]).T, ca.sin(phi[0]), ca.cos(phi[0])
    carried = ca.vertcat(-co * above[0] + s * above[1], s * above[0] + co * above[1])
    flexion = phi[0] - phi[1]
    lean = np.radians(20.0) * (1.0 - flexion / np.radians(75.0))
    lines = {
        "patellar tendon": ca.vertcat(ca.sin(lean), -ca.cos(lean)),
        "thigh": -ca.vertcat(ca.sin(flexion), ca.cos(flexion)),
        "shank": ca.DM([0.0, -1.0]),
    }
    pulls = sum((lines[row[8]] * forces[k] for k, row in enumerate(MUSCLES.values()) if row[8]), ca.SX.zeros(2))
    across = pulls - wrench[:2] - ca.vertcat(Rig().stiffness[0] * pose[0], 0.0) - carried
    about_x = ca.dot(ca.DM(FRONTAL_M), forces) + 1e-3 * body.lever_mm * ground[1] - 1e-3 * contact[3]
    pressure = -(ankle + body.ankle_height_m * ground[0])  # its centre times the vertical force
    room = ca.vertcat(pressure - body.heel_m * ground[1], body.toe_m * ground[1] - pressure)
    return ca.Function("leg", given, [motion, ca.vertcat(across, about_x), room])


@dataclass(frozen=True)
class Squat:
    """nlp with parameter w, its bounds on g and start x; unpack: x -> φ (3, n), a (10, n), poses (6, n)."""

    grid: Collocation
    nlp: dict[str, ca.MX]
    bounds: dict[str, Array]
    start: Array
    unpack: ca.Function


def build(
    model: SymbolicContact, body: Body, *, depth_deg: float = 80.0, duration_s: float = 3.0, intervals: int = 24
) -> Squat:
    """Transcribe the squat; flexion goes from 10° to the depth and back."""
    check_knee("a squat", model.scene, model.load_names)
    if not 10.0 < depth_deg <= 110.0:
        raise ValueError(f"the depth is {depth_deg}°, expected a knee flexion above 10° and up to 110°")
    grid = Collocation(intervals, 3, duration_s)
    points, times = 3 * intervals, grid.times_s

    def flexion(time_s: Any) -> Any:
        return np.radians(10.0 + 0.5 * (depth_deg - 10.0) * (1.0 - np.cos(2.0 * np.pi * time_s / duration_s)))

    opti = ca.Opti()
    weight = opti.parameter()
    node_phi, node_rates = opti.variable(3, intervals + 1), opti.variable(3, intervals + 1)
    phi, rates = opti.variable(3, points), opti.variable(3, points)
    a, knee = opti.variable(10, points), opti.variable(3, points)
    steps = KNEE_STEPS[[0, 1, 3]]  # mm, rad
    moved, zero = ca.diag(ca.DM(steps)) @ knee, ca.MX.zeros(1, points)
    pose = ca.vertcat(moved[0, :], moved[1, :], zero, moved[2, :], zero, phi[1, :] - phi[0, :])
    loads = model.function().map(points)(pose)
    wrench = ca.DM(total_selection(model.load_names, model.patch_names)) @ loads
    bend = grid.derivatives(node_rates, rates) / grid.step_s
    motion, across, room = leg(body).map(points)(phi, rates, bend, a, pose, wrench)

    opti.subject_to(grid.derivatives(node_phi, phi) == grid.step_s * rates)
    opti.subject_to(grid.jumps(node_phi, phi) == 0.0)
    opti.subject_to(grid.jumps(node_rates, rates) == 0.0)
    opti.subject_to(motion / 100.0 == 0.0)
    opti.subject_to(ca.diag(ca.DM([1e-3, 1e-3, 1e-2])) @ across == 0.0)
    opti.subject_to(phi[0, :] - phi[1, :] == flexion(times)[None])
    opti.subject_to(node_phi[0, 0] - node_phi[1, 0] == flexion(0.0))
    opti.subject_to(node_rates[:, 0] == 0.0)
    opti.subject_to(node_rates[[0, 2], -1] == 0.0)  # the thigh's follows
    opti.subject_to(ca.vec(room) / 100.0 >= 0.0)
    for part in (node_phi, phi):
        opti.subject_to(opti.bounded(ca.repmat(ca.DM([-0.2, -2.0, -0.4]), 1, part.shape[1]), part, [0.8, 0.2, 1.4]))
    opti.subject_to(opti.bounded(0.01, ca.vec(a), 1.0))
    for row, reach in ((0, 15.0), (2, 0.05)):  # mm, rad: the femur stays on the insert
        opti.subject_to(opti.bounded(-reach / steps[row], knee[row, :].T, reach / steps[row]))
    share = ca.DM(grid.weights)
    medial = -loads[model.load_names.index("Fy_med"), :].T / (body.mass_kg * GRAVITY)
    cost = ca.dot(share, ca.sum1(a**2).T) / 10.0 + weight * ca.dot(share, medial**2)
    opti.minimize(100.0 * (cost + 1e-3 * ca.sumsqr(a[:, 1:] - a[:, :-1])))

    # Start: segments lean by shares of the flexion, both sides of the knee pressed by 600 N, all muscles at 0.2.
    nodes = np.linspace(0.0, duration_s, intervals + 1)
    leans = {len(t): np.outer(flexion(t), [0.35, -0.65, 0.45]) for t in (nodes, times)}
    rest = np.tile(middle_pose(model), (points, 1)) * [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    rest[:, 5] = -flexion(times)
    held = settle_in_range(model, rest, rest, FREE, dict.fromkeys(SIDES, np.full(points, -600.0)))
    for t, angle, rate in ((nodes, node_phi, node_rates), (times, phi, rates)):
        opti.set_initial(angle, leans[len(t)].T)
        opti.set_initial(rate, np.gradient(leans[len(t)], t, axis=0).T)
    opti.set_initial(a, 0.2)
    opti.set_initial(knee, (held[:, [0, 1, 3]] / steps).T)
    nlp = {"x": opti.x, "p": opti.p, "f": opti.f, "g": opti.g}
    bounds = {"lbg": np.asarray(opti.debug.value(opti.lbg)), "ubg": np.asarray(opti.debug.value(opti.ubg))}
    start = np.asarray(opti.debug.value(opti.x, opti.initial()))
    return Squat(grid, nlp, bounds, start, ca.Function("unpack", [opti.x], [phi, a, pose]))


def trade_off(squat: Squat, weights: Iterable[float]) -> dict[float, Array]:
    """x of the squat for each weight w. The cost has many local optima and every squat is feasible at every weight:
    each weight begins at the cheapest of those found from heavier weights and from the start."""
    options = {"detect_simple_bounds": True}
    ways = (ipopt_options(tolerance=1e-6, mu_init=barrier) | options for barrier in (1e-2, 1e-4))
    far, near = (ca.nlpsol("squat", "ipopt", squat.nlp, way) for way in ways)
    cost = ca.Function("cost", [squat.nlp["x"], squat.nlp["p"]], [squat.nlp["f"]])

    def solve(solver: ca.Function, weight: float, x: Array) -> Array:
        answer = solver(x0=x, p=weight, **squat.bounds)
        if not solver.stats()["success"]:
            said = solver.stats()["return_status"]
            raise ValueError(f"no squat at weight {weight}: {said}; expected a lighter body or a shallower squat")
        return np.asarray(answer["x"])[:, 0]

    found = [solve(far, weight, squat.start) for weight in (0.0, 1e-3)]
    x = squat.start
    for weight in sorted(weights, reverse=True):
        x = solve(far, weight, x)
        found.append(x)

    def cheapest(weight: float) -> Array:
        return min(found, key=lambda x: float(cost(x, weight)))

    return {weight: solve(near, weight, cheapest(weight)) for weight in weights}


def main(
    scene: str = "knee",
    weights: str = "0,0.001,0.003,0.01,0.03,0.1,0.3,1",
    depth: float = 80.0,
    mass: float = 75.0,
    lever: float = 20.0,
    intervals: int = 24,
    out: Path = Path("results/squat"),
) -> None:
    """Squats with several weights on the medial contact force, on the foundation of a knee's scene."""
    model, body = cc.foundation(scene), Body(mass_kg=mass, lever_mm=lever)
    squat = build(model, body, depth_deg=depth, intervals=intervals)
    found = trade_off(squat, numbers(weights, "weights"))
    bodyweight, share = body.mass_kg * GRAVITY, squat.grid.weights
    rows, all_poses = [], []
    print("weight  mean squared activation  medial RMS, peak  lateral peak [BW]")
    for weight, x in found.items():
        _, a, poses = (np.asarray(part).T for part in squat.unpack(x))
        med, lat = -model(poses, SIDES).T / bodyweight
        rows.append((weight, share @ np.mean(a**2, axis=1), np.sqrt(share @ med**2), med.max(), lat.max()))
        print("{:6g} {:24.5f} {:11.3f} {:5.2f} {:13.2f}".format(*rows[-1]))
        all_poses.append(poses)
    poses = np.vstack(all_poses)
    print(verify(model, poses, reference_model(model)).line)

    out.mkdir(parents=True, exist_ok=True)
    names = ("weight", "mean_squared_activation", "medial_rms_bw", "medial_peak_bw", "lateral_peak_bw")
    table = np.array(rows)
    write_columns(out / "squat.csv", dict(zip(names, table.T, strict=True)), digits=9)
    page = new_page(11.0, 5.0)
    left, right = page.subplots(1, 2)
    left.plot(table[:, 2], table[:, 1], "o-")
    left.set(xlabel="medial force, RMS [BW]", ylabel="mean squared activation [-]")
    _, a, _ = (np.asarray(part).T for part in squat.unpack(found[min(found)]))
    right.plot(squat.grid.times_s, a, label=list(MUSCLES))
    right.set(xlabel="time [s]", ylabel=f"activation at weight {min(found):g} [-]")
    right.legend(fontsize=7)
    save_page(page, out / "squat.png")


if __name__ == "__main__":
    run_program(main)
