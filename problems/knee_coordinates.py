"""The six coordinates of the knee in inverse dynamics, and the contact load along each.

    Σ_m arm_m·F_m + contact on the femur = inverse dynamics        [N, N·m]

The femoral component moves, so that a translation's load is a force in the fixed frame, on the femur, and a
rotation's is the moment about the moving origin, along the axis of rx, ry or rz: Eᵀ(T - t×F), with T, F on the femur
about the fixed origin and E of `angular_velocity_map`. Measured loads of an instrumented implant balance so; with the
opposite sign they do not (tests/problems/test_muscle_contact.py).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array, angular_velocity_map

# Coordinates of inverse dynamics, each with the pose parameter it belongs to.
COORDINATES = {
    "knee_tx": "tx",
    "knee_ty": "ty",
    "knee_tz": "tz",
    "knee_adduction": "rx",
    "knee_rotation": "ry",
    "knee_flexion": "rz",
}
CONTACT_LOADS = ("Fy_med", "Fy_lat", "Fx", "Fz", "Tx", "Ty", "Tz")
LEVER_MM = 25.0  # turns moments into comparable forces


def load_unit(coordinate: str) -> str:
    """N for a translation, Nm for a rotation."""
    return "N" if COORDINATES[coordinate].startswith("t") else "Nm"


def in_newtons(coordinate: str) -> float:
    """Comparable newtons of one N or N·m of a coordinate's load."""
    return 1.0 if COORDINATES[coordinate].startswith("t") else 1000.0 / LEVER_MM


def contact_on_femur(poses: Array, loads: Array) -> dict[str, Array]:
    """Generalised loads (n,) [N, N·m] on the femur by coordinate, for poses (n, 6) and loads (n, 7) as in
    `CONTACT_LOADS`."""
    by_name = dict(zip(CONTACT_LOADS, loads.T, strict=True))
    force = np.column_stack([by_name["Fx"], by_name["Fy_med"] + by_name["Fy_lat"], by_name["Fz"]])
    moment = np.column_stack([by_name["Tx"], by_name["Ty"], by_name["Tz"]]) - np.cross(poses[:, :3], force)
    about_axes = np.einsum("nji,nj->ni", angular_velocity_map(poses[:, 3:]), moment)
    return dict(zip(COORDINATES, -np.column_stack([force, 1e-3 * about_axes]).T, strict=True))


def contact_expression(pose: ca.MX, loads: ca.MX) -> dict[str, ca.MX]:
    """`contact_on_femur` of one frame as CasADi expressions."""
    by_name = dict(zip(CONTACT_LOADS, ca.vertsplit(loads), strict=True))
    force = ca.vertcat(by_name["Fx"], by_name["Fy_med"] + by_name["Fy_lat"], by_name["Fz"])
    moment = ca.vertcat(by_name["Tx"], by_name["Ty"], by_name["Tz"]) - ca.cross(pose[:3], force)
    sx, cx, sy, cy = ca.sin(pose[3]), ca.cos(pose[3]), ca.sin(pose[4]), ca.cos(pose[4])
    axes = (ca.vertcat(1, 0, 0), ca.vertcat(0, cx, sx), ca.vertcat(sy, -sx * cy, cx * cy))  # of rx, ry, rz
    turns = [1e-3 * ca.dot(axis, moment) for axis in axes]
    return dict(zip(COORDINATES, [-load for load in (*ca.vertsplit(force), *turns)], strict=True))
