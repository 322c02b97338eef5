"""The six coordinates of the knee in inverse dynamics, and the contact load along each.

    Σ_m arm_m·F_m + contact on the femur = inverse dynamics        [N, N·m]

The femoral component moves, so that a translation's load is a force in the fixed frame, on the femur, and a
rotation's is the moment about the moving origin, along the axis of rx, ry or rz: Eᵀ(T - t×F), with T, F on the femur
about the fixed origin and E of `angular_velocity_map`. Measured loads of an instrumented implant balance so; with the
opposite sign they do not (tests/problems/test_muscle_measured.py).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.conventions import LEVER_MM, Array, angular_velocity_map
from casadi_contact.optimisation import generalised_forces
from problems.common.knee_scene import KNEE_LOADS

# Coordinates of inverse dynamics, each with the pose parameter it belongs to.
COORDINATES = {
    "knee_tx": "tx",
    "knee_ty": "ty",
    "knee_tz": "tz",
    "knee_adduction": "rx",
    "knee_rotation": "ry",
    "knee_flexion": "rz",
}


def is_translation(coordinate: str) -> bool:
    """Whether a coordinate moves the femur, and does not turn it."""
    return COORDINATES[coordinate].startswith("t")


def coordinate_unit(coordinate: str) -> str:
    """N for a translation, Nm for a rotation."""
    return "N" if is_translation(coordinate) else "Nm"


def in_newtons(coordinate: str) -> float:
    """Comparable newtons of one N or N·m of a coordinate's load."""
    return 1.0 if is_translation(coordinate) else 1000.0 / LEVER_MM


def contact_on_femur(poses: Array, loads: Array) -> dict[str, Array]:
    """Generalised loads (n,) [N, N·m] on the femur by coordinate, for poses (n, 6) and loads (n, 7) as in
    `KNEE_LOADS`."""
    by_name = dict(zip(KNEE_LOADS, loads.T, strict=True))
    force = np.column_stack([by_name["Fx"], by_name["Fy_med"] + by_name["Fy_lat"], by_name["Fz"]])
    moment = np.column_stack([by_name["Tx"], by_name["Ty"], by_name["Tz"]]) - np.cross(poses[:, :3], force)
    about_axes = np.einsum("nji,nj->ni", angular_velocity_map(poses[:, 3:]), moment)
    return dict(zip(COORDINATES, -np.column_stack([force, 1e-3 * about_axes]).T, strict=True))


def contact_expression(pose: ca.MX, loads: ca.MX) -> dict[str, ca.MX]:
    """`contact_on_femur` of one frame as CasADi expressions."""
    by_name = dict(zip(KNEE_LOADS, ca.vertsplit(loads), strict=True))
    fy = by_name["Fy_med"] + by_name["Fy_lat"]
    wrench = ca.vertcat(by_name["Fx"], fy, *(by_name[name] for name in ("Fz", "Tx", "Ty", "Tz")))
    on_tibia = generalised_forces(pose, wrench) * ca.DM([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    return dict(zip(COORDINATES, ca.vertsplit(-on_tibia), strict=True))
