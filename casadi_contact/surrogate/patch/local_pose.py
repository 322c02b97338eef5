"""Local pose of a patch: x_p = (t + R(q)·a_p, q) for its anchor a_p on the moving body, in NumPy and as CasADi MX.

With v = R·a and e_1, e_2, e_3 the axes of rotation (e_x, Rx·e_y, Rx·Ry·e_z):

    dv/dq_j = e_j × v,    d²v/dq_i dq_j = e_i × (e_j × v) for i <= j,    dx_p/dpose = A = [[I, B], [0, I]]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array, angular_velocity_map, rotation

Triple = tuple[ca.MX, ca.MX, ca.MX]


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


@dataclass(frozen=True)
class LocalPose:
    """x (6) as an expression of the pose, with A (6 x 6) and, row by component, d²v (3 x 9); None at the origin."""

    x: ca.MX
    A: ca.MX | None
    d2v: ca.MX | None

    def pull_back(self, rows: ca.MX) -> ca.MX:
        """Derivatives d/dx_p (m x 6) -> d/dpose (m x 6)."""
        return rows if self.A is None else ca.mtimes(rows, self.A)

    def pull_back_second(self, rows: ca.MX, hessians: Sequence[ca.MX]) -> ca.MX:
        """Rows d/dx_p (m x 6) and m matrices d²/dx_p² -> (m x 36), row k the stacked columns of d²/dpose²."""
        m = len(hessians)
        if self.A is None or self.d2v is None:
            return ca.reshape(ca.horzcat(*hessians), 36, m).T
        halfway = ca.horzcat(*ca.vertsplit(ca.mtimes(ca.vertcat(*hessians), self.A), 6))
        bent = ca.mtimes(ca.mtimes(rows[:, :3], self.d2v), ca.MX(_ROTATION_BLOCK))
        return ca.reshape(ca.mtimes(self.A.T, halfway), 36, m).T + bent


# Puts the nine entries (q_i, q_j) of a 3 x 3 block, columns stacked, into a stacked 6 x 6 matrix.
_ROTATION_BLOCK = ca.DM(
    ca.Sparsity.triplet(9, 36, list(range(9)), [3 + j + 6 * (3 + i) for i in range(3) for j in range(3)]), 1.0
)


def _combine(anchor: Array, terms: Triple) -> ca.MX:
    """Σ_j a_j·term_j, without the terms whose a_j is zero."""
    total = ca.MX(0.0)
    for a, term in zip(anchor, terms, strict=True):
        if a != 0.0:
            total = total + float(a) * term
    return total


def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def local_pose_expressions(pose: ca.MX, anchors_mm: Array) -> list[LocalPose]:
    """Local pose of every patch as CasADi expressions, for anchors (P, 3); sines and cosines are shared."""
    angles = pose[3:6]
    sx, sy, sz = ca.vertsplit(ca.sin(angles))
    cx, cy, cz = ca.vertsplit(ca.cos(angles))
    rotation = (
        (cy * cz, -cy * sz, sy),
        (cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
        (sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
    )
    zero, one = ca.MX(0.0), ca.MX(1.0)
    axes = ((one, zero, zero), (zero, cx, sx), (sy, -sx * cy, cx * cy))
    poses = []
    for anchor in np.asarray(anchors_mm, dtype=float):
        if not anchor.any():
            poses.append(LocalPose(pose, None, None))
            continue
        v = (_combine(anchor, rotation[0]), _combine(anchor, rotation[1]), _combine(anchor, rotation[2]))
        dv = [_cross(axis, v) for axis in axes]
        d2v = {(i, j): _cross(axes[i], dv[j]) for j in range(3) for i in range(j + 1)}
        B = ca.horzcat(*(ca.vertcat(*column) for column in dv))
        A = ca.vertcat(ca.horzcat(ca.MX(ca.DM.eye(3)), B), ca.horzcat(ca.MX(3, 3), ca.MX(ca.DM.eye(3))))
        blocks = [ca.vertcat(*d2v[min(i, j), max(i, j)]) for j in range(3) for i in range(3)]
        poses.append(LocalPose(ca.vertcat(pose[:3] + ca.vertcat(*v), angles), A, ca.horzcat(*blocks)))
    return poses
