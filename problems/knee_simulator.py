"""A load-driven knee simulator in the manner of ISO 14243-1: forward simulation of a walking cycle.

    states      q = (tx, ty, tz, rx, ry) [mm, rad] and v = q̇; the flexion rz(t) is prescribed
    given       axial force 5 mm medially of the moving origin, anterior-posterior force, internal-external torque
    equations   M·v̇ = Q(q; given(t)) - Q(q; contact(q)) - k·q - c·v

Q are generalised forces (`generalised_forces`), k springs that stand for soft tissue. The energy balance checks the
integrator:

    work of given loads + work of the flexion drive = Δkinetic + Δsprings + dissipation + work against contact

Where the scene has friction, contact depends on q̇ as well. The same equations run on the surrogate and on the
foundation of its scene, by CVODES with the exact Jacobian.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.joint_mechanics import generalised_forces
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.starts import KNEE_STEPS, press_together
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.scenes.material import Friction
from casadi_contact.scenes.pose_file import write_poses
from problems.contact_source import wrench_function


@dataclass(frozen=True)
class Rig:
    """Diagonals of M [t, t·mm²], c [N·s/mm, N·mm·s/rad] and k [N/mm, N·mm/rad] for (tx, ty, tz, rx, ry)."""

    inertia: tuple[float, ...] = (5e-3, 5e-3, 5e-3, 20.0, 20.0)  # 5 kg, 0.02 kg·m²
    damping: tuple[float, ...] = (1.0, 5.0, 1.0, 5000.0, 1000.0)
    stiffness: tuple[float, ...] = (30.0, 0.0, 0.0, 0.0, np.degrees(600.0))
    axial_offset_mm: float = 5.0
    period_s: float = 1.0


def walking(share: Any, load_scale: float) -> tuple[Any, Any, Any, Any]:
    """Flexion [deg], axial and anterior-posterior force [N], torque [N·mm] at a share of the cycle.

    Sums of smooth periodic bumps (height, centre, width) with the magnitudes of ISO 14243-1."""

    def bumps(*parts: tuple[float, float, float]) -> Any:
        return sum(h * ca.exp((ca.cos(2.0 * np.pi * (share - c)) - 1.0) / (2.0 * np.pi * w) ** 2) for h, c, w in parts)

    flexion = 0.5 + bumps((14.5, 0.15, 0.055), (3.0, 0.37, 0.08), (57.0, 0.72, 0.085))
    axial = 168.0 + bumps((2150.0, 0.13, 0.05), (700.0, 0.27, 0.08), (2310.0, 0.45, 0.065))
    ap = bumps((110.0, 0.05, 0.03), (-160.0, 0.16, 0.05), (-265.0, 0.5, 0.07))
    ie = bumps((1000.0, 0.12, 0.05), (-6000.0, 0.47, 0.075))
    return flexion, load_scale * axial, load_scale * ap, load_scale * ie


@dataclass(frozen=True)
class KneeSimulator:
    """CasADi functions. pose, contact: (q, t) -> pose (6), (x, t) -> wrench on the insert (6); rate: (x, t) -> ẋ (10);
    powers: (x, t) -> powers [N·mm/s] of given loads with flexion drive, of the damper, against contact; x = (q, v)."""

    model: ContactModel
    rig: Rig
    pose: ca.Function
    contact: ca.Function
    rate: ca.Function
    powers: ca.Function
    given: ca.Function


def build(model: ContactModel, waveforms: Any = walking, load_scale: float = 0.8) -> KneeSimulator:
    """Equations of motion on any contact model whose bodies are pressed together along -Fy.

    waveforms: (share of the cycle, load_scale) -> flexion [deg], axial force, anterior-posterior force [N], torque
    [N·mm]. At full load (1.0) the lateral side would bear more than the surrogate `knee` has learned."""
    rig = Rig()
    if any((normal.component, normal.sign) != ("Fy", -1.0) for normal in model.scene.normal_loads):
        raise ValueError(f"scene {model.scene.name} is not pressed along -Fy, expected a knee or one like it")
    q, v, t, wrench = (ca.SX.sym(name, rows) for name, rows in (("q", 5), ("v", 5), ("t", 1), ("wrench", 6)))
    flexion, axial, ap, ie = waveforms(t / rig.period_s, load_scale)
    pose = ca.vertcat(q, -np.pi / 180.0 * flexion)
    given = ca.vertcat(ap, -axial, 0, rig.axial_offset_mm * axial, ie, 0)
    by_given, by_contact = generalised_forces(pose, given, about="moving"), -generalised_forces(pose, wrench)
    damper = ca.DM(rig.damping) * v
    forces = (by_given + by_contact)[:5] - ca.DM(rig.stiffness) * q - damper
    speed = ca.vertcat(v, ca.jacobian(pose[5], t))
    drive = -(by_given + by_contact)[5] * speed[5]
    powers = ca.vertcat(ca.dot(by_given, speed) + drive, ca.dot(v, damper), -ca.dot(by_contact, speed))
    pose_of = ca.Function("pose", [q, t], [pose])
    moved = ca.Function("moved", [q, v, t, wrench], [ca.vertcat(v, forces / ca.DM(rig.inertia)), powers])
    rubs, speed_of = model.scene.friction != Friction(), ca.Function("speed", [v, t], [speed])
    contact = wrench_function(model, velocity=rubs)
    x, at = ca.MX.sym("x", 10), ca.MX.sym("t")
    pressed = contact(pose_of(x[:5], at), *([speed_of(x[5:], at)] if rubs else []))
    rate, power = moved(x[:5], x[5:], at, pressed)
    of_state = {"contact": pressed, "rate": rate, "powers": power}
    functions = {name: ca.Function(name, [x, at], [of]) for name, of in of_state.items()}
    return KneeSimulator(model, rig, pose_of, **functions, given=ca.Function("given", [t], [given]))


def start_state(simulator: KneeSimulator) -> Array:
    """State (10,) at rest under the loads at t = 0: Newton's method on v̇ = 0, from where the sides carry them."""
    rest = np.asarray(simulator.pose(np.zeros(5), 0.0)).T
    rest[:, 1] = simulator.model.scene.start_pose[1]
    pressed = press_together(symbolic(simulator.model), rest, rest, np.asarray(simulator.given(0.0)).T, POSE_NAMES[:5])
    q = ca.MX.sym("q", 5)
    acceleration = simulator.rate(ca.vertcat(ca.DM(KNEE_STEPS[:5]) * q, ca.DM.zeros(5)), 0.0)[5:]
    scaled = ca.Function("left", [q], [ca.DM(simulator.rig.inertia) / np.array([1, 1, 1, 25, 25]) * acceleration])
    found = ca.rootfinder("rest", "newton", scaled, {"abstol": 1e-9})(pressed[0, :5] / KNEE_STEPS[:5])
    return np.append(np.asarray(found)[:, 0] * KNEE_STEPS[:5], np.zeros(5))


@dataclass(frozen=True)
class Motion:
    """time_s (n,), states (n, 10), poses (n, 6), wrenches on the insert (n, 6), work (n, 3) of `KneeSimulator.powers`
    since the start [N·mm]; steps and seconds of the integrator."""

    time_s: Array
    states: Array
    poses: Array
    wrenches: Array
    work: Array
    steps: int
    seconds: float

    def energy_error(self, rig: Rig) -> Array:
        """Energy (n,) [N·mm] that the integrator made or lost."""
        q, v = np.split(self.states, 2, axis=1)
        stored = 0.5 * v**2 @ np.array(rig.inertia) + 0.5 * q**2 @ np.array(rig.stiffness)
        return self.work @ [1.0, -1.0, -1.0] - (stored - stored[0])


def simulate(
    simulator: KneeSimulator, start: Array, *, cycles: float = 1.0, frames: int = 101, tolerance: float = 1e-6
) -> Motion:
    """Integrate from a state (10,) by CVODES with the exact Jacobian; tolerance: relative, absolute [mm, rad, s]."""
    x, t, time_s = ca.MX.sym("x", 10), ca.MX.sym("t"), np.linspace(0.0, cycles * simulator.rig.period_s, frames)
    dae = {"x": x, "t": t, "ode": simulator.rate(x, t), "quad": simulator.powers(x, t)}
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100_000}
    integrate = ca.integrator("motion", "cvodes", dae, float(time_s[0]), time_s[1:].tolist(), options)
    began = time.perf_counter()
    answer = integrate(x0=start)
    seconds = time.perf_counter() - began
    states, work = (np.vstack([s, np.asarray(answer[key]).T]) for s, key in ((start, "xf"), (np.zeros(3), "qf")))
    poses = np.asarray(simulator.pose.map(frames)(states[:, :5].T, time_s[None])).T
    wrenches = np.asarray(simulator.contact.map(frames)(states.T, time_s[None])).T
    return Motion(time_s, states, poses, wrenches, work, int(integrate.stats()["nsteps"]), seconds)


def rubbing(friction: float) -> dict[str, Any]:
    """What a coefficient of friction replaces in a scene; nothing for none. Knees slide at some 10 mm/s."""
    return {"dynamic_friction": friction, "transition_velocity": 2.0} if friction else {}


def main(
    surrogate: str = "knee",
    load_scale: float = 0.8,
    cycles: float = 1.0,
    friction: float = 0.0,
    out: Path = Path("results/knee_simulator"),
) -> None:
    """Compare cycles on a surrogate and on its scene's foundation. friction: of polyethylene 0.04 to 0.07."""
    model = cc.load_surrogate(surrogate, **rubbing(friction))
    models = {"surrogate": model, "foundation": cc.foundation(model.scene)}
    simulators = {name: build(each, load_scale=load_scale) for name, each in models.items()}
    start = start_state(simulators["surrogate"])
    motions = {name: simulate(one, start, cycles=cycles, tolerance=1e-4) for name, one in simulators.items()}
    exact = simulate(simulators["surrogate"], start, cycles=cycles, tolerance=1e-8)

    print("contact    steps  seconds a cycle  largest difference from the surrogate at 1e-8")
    for name, motion in motions.items():
        off = np.abs(motion.poses - exact.poses)
        apart = f"{off[:, :3].max():.4f} mm, {np.degrees(off[:, 3:].max()):.4f}°"
        print(f"{name:10s} {motion.steps:5d}  {motion.seconds / cycles:15.3f}  {apart}")
    print(verify(model, exact.poses, reference_model(model)).line)
    lost = np.abs(exact.energy_error(simulators["surrogate"].rig)).max()
    print(f"energy brought in {np.abs(exact.work[:, 0]).max():.4g} N·mm, not accounted for {lost:.2g} N·mm")

    out.mkdir(parents=True, exist_ok=True)
    write_poses(exact.time_s, exact.poses, out / "knee_simulator.csv")
    page = new_page(11.0, 6.0)
    axes = page.subplots(2, 3).ravel()
    axes[0].plot(exact.time_s, -exact.wrenches[:, 1])
    axes[0].set_ylabel("compression [N]")
    for axis, column in zip(axes[1:], range(5), strict=True):
        unit = np.degrees if column > 2 else np.asarray
        axis.plot(exact.time_s, unit(exact.poses[:, column]), label="surrogate")
        axis.plot(exact.time_s, unit(motions["foundation"].poses[:, column]), "--", label="foundation")
        axis.set_ylabel(f"{POSE_NAMES[column]} [{'degrees' if column > 2 else 'mm'}]")
    axes[1].legend()
    for axis in axes:
        axis.set_xlabel("time [s]")
    save_page(page, out / "knee_simulator.png")


if __name__ == "__main__":
    run_program(main)
