"""A start in contact for settling, from wherever a pose may be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import WRENCH_NAMES, Array, pose_index
from casadi_contact.statics import settle
from casadi_contact.structures import Surrogate
from problems.learned_range import pose_bounds

_LEAST_FORCE_N = 20.0  # of each side, so that a start is always in contact


def pressed_together(surrogate: Surrogate, poses: Array, rest: Array, loads: Array, free: Sequence[str]) -> Array:
    """Poses (n, 6) in the learned range, locked parameters as at rest (n, 6), ty and rx settled under each side's share
    of the loads (n, 6), as far as these are free and there are two sides.

    The shares are two vertical forces at the condyles' centres with the wanted Fy and Tx. Settling compares root
    loads, which keep their slope out of contact; where it leads out of the learned range, it begins again at rest.
    """
    columns = [pose_index(name) for name in free]
    locked = [i for i in range(6) if i not in columns]
    low, high = pose_bounds(surrogate)
    poses = poses.copy()
    poses[:, columns] = np.clip(poses[:, columns], low[columns], high[columns])
    poses[:, locked] = rest[:, locked]
    sides, anchors_z = surrogate.scene.sensitive_loads, surrogate.scene.anchors_mm[:, 2]
    if len(sides) != 2 or not {"ty", "rx"} <= set(free):
        return poses
    down = -loads[:, WRENCH_NAMES.index("Fy")]
    first = (loads[:, WRENCH_NAMES.index("Tx")] - anchors_z[1] * down) / (anchors_z[0] - anchors_z[1])
    least = np.minimum(_LEAST_FORCE_N, np.maximum(0.5 * down, 1.0))
    first = np.clip(first, least, np.maximum(down - least, least))
    shares = {sides[0]: -first, sides[1]: -np.maximum(down - first, least)}
    inside = np.zeros(len(poses), dtype=bool)
    for begin in (poses, rest):
        tried, report = settle(surrogate, begin, ("ty", "rx"), shares, tolerance=1.0, max_iterations=30)
        good = ~inside & report.converged & ((tried >= low) & (tried <= high))[:, columns].all(axis=1)
        poses = np.where(good[:, None], tried, poses)
        inside |= good
    return poses
