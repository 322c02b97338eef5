"""A drop by OpenSim's equations of motion, on an exported contact kernel (see `problems/opensim_drop.py`).

    python opensim_force.py KERNEL SETTINGS        prints the poses; settings and poses are JSON

A script without casadi_contact: the packages of OpenSim and CasADi must not share a process. OpenSim's lengths are m,
the kernel's mm. The kernel's wrench acts on the fixed body about the fixed origin; a BodyActuator puts its opposite on
the falling body, about that body's origin, as controls that follow the state.
"""

import ctypes
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import opensim
from scipy.integrate import solve_ivp


def contact_wrench(library: Path, total: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Function pose (6) [mm, rad] -> wrench (6) [N, N·mm] on the fixed body; total (6, loads) adds up the loads."""
    kernel = ctypes.CDLL(str(library.resolve())).contact_loads
    vector = np.ctypeslib.ndpointer(dtype=float, flags="C_CONTIGUOUS")
    kernel.argtypes, kernel.restype = (vector, vector), None

    def wrench(pose: np.ndarray) -> np.ndarray:
        loads = np.empty(total.shape[1])
        kernel(np.ascontiguousarray(pose), loads)
        return np.asarray(total @ loads)

    return wrench


class FallingBody:
    """A free body in OpenSim, with one actuator for all that acts on it. States q = (rx ry rz tx ty tz), u = (ω, v)."""

    def __init__(self, mass_kg: float, inertia_kgm2: float) -> None:
        self.model = opensim.Model()
        self.model.setGravity(opensim.Vec3(0.0))
        inertia = opensim.Inertia(inertia_kgm2, inertia_kgm2, inertia_kgm2)
        body = opensim.Body("falling", mass_kg, opensim.Vec3(0.0), inertia)
        self.model.addBody(body)
        self.model.addJoint(opensim.FreeJoint("free", self.model.getGround(), body))
        actuator = opensim.BodyActuator()
        actuator.setName("contact")
        actuator.setBody(body)
        actuator.set_spatial_force_is_global(True)
        self.model.addForce(actuator)
        self.state = self.model.initSystem()

    def rates(self, q: np.ndarray, u: np.ndarray, torque: np.ndarray, force: np.ndarray) -> np.ndarray:
        """q̇ and u̇ (12) under a torque [N·m] about the body's origin and a force [N] there, both in the ground."""
        states, speeds, controls = self.state.updQ(), self.state.updU(), opensim.Vector(6, 0.0)
        for i in range(6):
            states[i], speeds[i] = float(q[i]), float(u[i])
        for i, value in enumerate([*torque, *force]):
            controls.set(i, float(value))
        self.model.realizeVelocity(self.state)
        self.model.setControls(self.state, controls)
        self.model.realizeAcceleration(self.state)
        q_dot, u_dot = self.state.getQDot(), self.state.getUDot()
        return np.array([q_dot[i] for i in range(6)] + [u_dot[i] for i in range(6)])


def simulate(library: Path, drop: Mapping[str, Any]) -> np.ndarray:
    """Poses (points, 6) [mm, rad] of the drop."""
    body = FallingBody(drop["mass_kg"], drop["inertia_kgm2"])
    wrench_of = contact_wrench(library, np.array(drop["total"]))

    def rates(time: float, state: np.ndarray) -> np.ndarray:
        q, u = state[:6], state[6:]
        pose = np.concatenate([1e3 * q[3:], q[:3]])
        wrench = wrench_of(pose)
        torque_nmm = -wrench[3:] + np.cross(pose[:3], wrench[:3])
        force = -wrench[:3] + np.array([0.0, drop["push_n"], 0.0]) - drop["damping_ns_per_m"] * u[3:]
        return body.rates(q, u, 1e-3 * torque_nmm - drop["damping_nms_per_rad"] * u[:3], force)

    pose, times = np.array(drop["start_pose"]), drop["times_s"]
    start = np.concatenate([pose[3:], 1e-3 * pose[:3], np.zeros(6)])
    solved = solve_ivp(rates, (times[0], times[-1]), start, "LSODA", times, rtol=1e-9, atol=1e-12)
    if not solved.success:
        raise ValueError(f"the integrator gave up: {solved.message}")
    return np.column_stack([1e3 * solved.y[3:6].T, solved.y[:3].T])


def main() -> None:
    """Simulate, and print the poses."""
    poses = simulate(Path(sys.argv[1]), json.loads(sys.argv[2]))
    print(json.dumps({"opensim": opensim.GetVersion(), "poses": poses.tolist()}))


if __name__ == "__main__":
    main()
