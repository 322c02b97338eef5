"""States of a contact: insensitive pose parameters and root loads, in which errors of like size lie together.

    y = (x/scale, r/root_scale),   r = ½(v + √(v² + root_scale²)),   v = s + 2·root_scale

In the pose itself a patch that is pressed and one that is lifted off are microns apart. r follows the root load s of a
patch in contact and goes to zero where it is lifted off, however far.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array, pose_index
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.cut_off import cut_off, cut_off_expression
from casadi_contact.surrogate.gaussian_kernels import kernel_expressions, weighted_mean


@dataclass(frozen=True)
class States:
    """columns (k,) of the pose with their scale (k,) [mm, rad]; root_scale (P,); centres (K, k + P) and bandwidth."""

    columns: Array
    scale: Array
    root_scale: Array
    centres: Array
    bandwidth: float

    def points(self, poses: Array, roots: Array) -> Array:
        """y (n, k + P) of poses (n, 6) and root loads (n, P)."""
        x = cut_off(poses[:, self.columns.astype(int)] / self.scale)
        v = cut_off(roots) + 2.0 * self.root_scale
        return np.hstack([x, 0.5 * (v + np.sqrt(v * v + self.root_scale**2)) / self.root_scale])

    def mean(self, poses: Array, roots: Array, values: Array) -> Array:
        """Mean (n, L) of the centres' values (K, L) around each pose."""
        return weighted_mean(self.points(poses, roots), self.centres, self.bandwidth, values)

    def mean_expression(self, pose: ca.MX, roots: ca.MX, values: Array) -> ca.MX:
        """The same (L) of a pose (6)."""
        x = cut_off_expression(pose[[int(c) for c in self.columns]] / ca.DM(self.scale))
        scale = ca.DM(self.root_scale)
        v = cut_off_expression(roots) + 2.0 * scale
        y = ca.vertcat(x, 0.5 * (v + ca.sqrt(v * v + scale**2)) / scale)
        return ca.mtimes(ca.DM(values.T), kernel_expressions(y, self.centres, self.bandwidth)[1])


def state_columns(scene: Scene) -> list[int]:
    """Columns of the pose that tell the state of a contact beside its root loads, which stand for as many sensitive
    parameters. Of a ball in a cup, whose three are told by one root load, all six do."""
    told = len(scene.sensitive_pose) <= len(scene.patch_names)
    return [pose_index(name) for name in (scene.insensitive_pose if told else POSE_NAMES)]
