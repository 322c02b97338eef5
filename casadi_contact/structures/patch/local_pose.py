"""Local pose of a patch: x_p = (t + R(q)·a_p, rx, ry, rz) for its anchor a_p on the moving body (README)."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import Array, angular_velocity_map, rotation


def local_poses(poses: Array, anchor_mm: Array) -> Array:
    """x_p of shape (n, 6) for poses (n, 6): position of the anchor in the fixed frame [mm] and the same angles."""
    local = np.array(poses)
    local[:, :3] += rotation(poses[:, 3:]) @ anchor_mm
    return local


def local_pose_jacobian(poses: Array, anchor_mm: Array) -> Array:
    """dx_p/dpose of shape (n, 6, 6) = [[I, B], [0, I]] with columns B_i = e_i × (R a), e_i the axes of rotation."""
    jacobian = np.broadcast_to(np.eye(6), (len(poses), 6, 6)).copy()
    axes = angular_velocity_map(poses[:, 3:])
    arm = rotation(poses[:, 3:]) @ anchor_mm
    jacobian[:, :3, 3:] = np.cross(axes, arm[:, :, None], axis=1)
    return jacobian
