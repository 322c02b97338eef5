"""The same drop by OpenSim and by CasADi: a component falls onto the other, on one exported contact kernel.

    states      pose q (6) [mm, rad], velocity v [mm/s] and angular velocity ω [rad/s] in the fixed frame
    equations   q̇ = (v, E(q)⁻¹·ω),    m·v̇ = push - contact force - c·v,    I·ω̇ = -contact torque - d·ω

with one moment of inertia I for all axes, and contact's torque about the moving origin, t × F subtracted. CasADi
integrates by CVODES on the surrogate's functions. OpenSim integrates its own equations of motion in another process
(`problems/opensim_force.py`), with the kernel's C code called as a force: its package and CasADi's must not share one.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.core.compiler import shared_library
from casadi_contact.core.conventions import POSE_NAMES, POSE_UNITS, Array
from casadi_contact.core.terminal import run_program
from casadi_contact.export.c_source import c_source, header
from casadi_contact.networks.frames import angular_velocity_map
from casadi_contact.optimisation.joint_mechanics import total_selection
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import SURROGATE, TARGET, new_page, save_page
from casadi_contact.scenes.pose_file import write_poses
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.opensim_import.process import run_opensim


@dataclass(frozen=True)
class Drop:
    """A body at rest at a pose (6,) [mm, rad], pushed along y and damped at its origin."""

    start_pose: tuple[float, ...]
    mass_kg: float = 1.0
    inertia_kgm2: float = 1e-3
    push_n: float = -400.0
    damping_ns_per_m: float = 200.0
    damping_nms_per_rad: float = 0.5
    duration_s: float = 0.05
    points: int = 201

    @property
    def times_s(self) -> Array:
        """Times of the results."""
        return np.linspace(0.0, self.duration_s, self.points)


def by_casadi(surrogate: Surrogate, drop: Drop, tolerance: float = 1e-10) -> Array:
    """Poses (points, 6) [mm, rad] by CVODES, in t, mm, s, so that forces are N."""
    state = ca.MX.sym("state", 12)
    pose, velocity, spin = state[:6], state[6:9], state[9:]
    total = total_selection(surrogate.load_names, surrogate.patch_names)
    wrench = total @ surrogate.function()(pose)
    force = -wrench[:3] + ca.DM([0.0, drop.push_n, 0.0]) - 1e-3 * drop.damping_ns_per_m * velocity
    torque = -wrench[3:] + ca.cross(pose[:3], wrench[:3]) - 1e3 * drop.damping_nms_per_rad * spin
    turning = ca.solve(angular_velocity_map(pose[3:]), spin)
    rates = ca.vertcat(velocity, turning, force / (1e-3 * drop.mass_kg), torque / (1e3 * drop.inertia_kgm2))
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100_000}
    fall = ca.integrator("fall", "cvodes", {"x": state, "ode": rates}, 0.0, drop.times_s[1:].tolist(), options)
    answer = fall(x0=np.append(drop.start_pose, np.zeros(6)))
    return np.vstack([drop.start_pose, np.asarray(answer["xf"]).T[:, :6]])


def by_opensim(surrogate: Surrogate, drop: Drop) -> tuple[Array, str]:
    """Poses (points, 6) [mm, rad] by OpenSim in a process of its own, and its version."""
    model = surrogate.exported()
    source = c_source(model, "contact").replace('#include "contact.h"', header(model, "contact"))
    total = total_selection(surrogate.load_names, surrogate.patch_names).tolist()
    settings = {**asdict(drop), "times_s": drop.times_s.tolist(), "total": total}
    script = Path(__file__).with_name("opensim_force.py")
    said = run_opensim(str(script), str(shared_library(source)), json.dumps(settings))
    answer = json.loads(said.splitlines()[-1])
    return np.array(answer["poses"]), answer["opensim"]


def main(
    surrogate: str = "knee", lift_mm: float = 0.3, push_n: float = 400.0, out: Path = Path("results/opensim_drop")
) -> None:
    """Let a component fall from lift_mm above a pose that the surrogate has learned, by OpenSim and by CasADi."""
    model = cc.load_surrogate(surrogate)
    start = np.array(model.example_pose()) + lift_mm * np.eye(6)[1]
    drop = Drop(tuple(start.tolist()), push_n=-push_n)
    (opensim, version), casadi = by_opensim(model, drop), by_casadi(model, drop)
    off, travel = np.abs(opensim - casadi).max(axis=0), np.ptp(casadi, axis=0)
    print(verify(model, casadi, reference_model(model)).line)
    print(f"pose parameter  travel  largest difference of OpenSim {version}")
    for name, unit, far, apart in zip(POSE_NAMES, POSE_UNITS, travel, off, strict=True):
        print(f"{name} [{unit}]".ljust(14), f"{far:7.3g} {apart:10.1e}")

    out.mkdir(parents=True, exist_ok=True)
    write_poses(drop.times_s, casadi, out / "opensim_drop.csv")
    page = new_page(11.0, 5.0)
    for k, axis in enumerate(page.subplots(2, 3).ravel()):
        axis.plot(1e3 * drop.times_s, opensim[:, k], label="OpenSim", **TARGET)
        axis.plot(1e3 * drop.times_s, casadi[:, k], label="CVODES", **SURROGATE)
        axis.set(xlabel="time [ms]", ylabel=f"{POSE_NAMES[k]} [{POSE_UNITS[k]}]")
        axis.legend(fontsize=8)
    save_page(page, out / "opensim_drop.png")


if __name__ == "__main__":
    run_program(main)
