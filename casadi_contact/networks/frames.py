"""Poses of bodies against one another, as CasADi expressions.

A pose (t, r) in the ground takes a body's point q to t + R·q, R = Rx(rx)·Ry(ry)·Rz(rz). Of a moving in a fixed frame

    R = R_fᵀ·R_m,   t = R_fᵀ·(t_m - t_f),   rx = atan2(-R_yz, R_zz),  ry = asin(R_xz),  rz = atan2(-R_xy, R_xx)

which is smooth as long as |ry| < 90°.
"""

from typing import Any

import casadi as ca


def rotation(angles: Any) -> Any:
    """R (3 x 3) of the angles (3) [rad]."""
    sx, sy, sz = (ca.sin(angles[i]) for i in range(3))
    cx, cy, cz = (ca.cos(angles[i]) for i in range(3))
    return ca.vertcat(
        ca.horzcat(cy * cz, -cy * sz, sy),
        ca.horzcat(cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
        ca.horzcat(sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
    )


def angular_velocity_map(angles: Any) -> Any:
    """E (3 x 3) with ω = E·(ṙx, ṙy, ṙz), as a CasADi expression of the angles (3)."""
    sx, sy, cx, cy = ca.sin(angles[0]), ca.sin(angles[1]), ca.cos(angles[0]), ca.cos(angles[1])
    return ca.vertcat(ca.horzcat(1, 0, sy), ca.horzcat(0, cx, -sx * cy), ca.horzcat(0, sx, cx * cy))


def placed(pose: Any, frame: Any) -> tuple[Any, Any]:
    """Origin (3) and rotation (3 x 3) in the ground of a frame (6) that is fixed to a body at a pose (6)."""
    R = rotation(pose[3:])
    return pose[:3] + ca.mtimes(R, frame[:3]), ca.mtimes(R, rotation(frame[3:]))


def relative_pose(fixed: tuple[Any, Any], moving: tuple[Any, Any]) -> Any:
    """Pose (6) of the moving frame in the fixed one, each an origin and a rotation as from `placed`."""
    (t_f, R_f), (t_m, R_m) = fixed, moving
    return pose_of(ca.mtimes(R_f.T, t_m - t_f), ca.mtimes(R_f.T, R_m))


def pose_of(t: Any, R: Any) -> Any:
    """Pose (6) of a frame with origin t (3) and rotation R (3 x 3)."""
    return ca.vertcat(t, ca.atan2(-R[1, 2], R[2, 2]), ca.asin(R[0, 2]), ca.atan2(-R[0, 1], R[0, 0]))
