"""The drop by CVODES on the surrogate's CasADi functions, in mm, t, s and so N."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.joint_mechanics import angular_velocity_map, total_selection
from problems.opensim_drop.problem import Drop


def simulate(drop: Drop, tolerance: float = 1e-10) -> Array:
    """Poses (points, 6) [mm, rad]; the states are pose, velocity and angular velocity in the fixed frame."""
    state = ca.MX.sym("state", 12)
    pose, velocity, spin = state[:6], state[6:9], state[9:]
    surrogate = drop.surrogate
    total = total_selection(surrogate.load_names, surrogate.patch_names)
    wrench = total @ surrogate.function(compiled=True)(pose)
    force = -wrench[:3] + ca.DM(drop.push_n) - 1e-3 * drop.damping_ns_per_m * velocity
    torque = -wrench[3:] + ca.cross(pose[:3], wrench[:3]) - 1e3 * drop.damping_nms_per_rad * spin
    rates = ca.vertcat(
        velocity,
        ca.solve(angular_velocity_map(pose[3:]), spin),
        force / (1e-3 * drop.mass_kg),
        torque / (1e3 * drop.inertia_kgm2),
    )
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100_000}
    fall = ca.integrator("fall", "cvodes", {"x": state, "ode": rates}, 0.0, drop.times_s[1:].tolist(), options)
    start = np.append(drop.start_pose, np.zeros(6))
    return np.vstack([drop.start_pose, np.asarray(fall(x0=start)["xf"]).T[:, :6]])
