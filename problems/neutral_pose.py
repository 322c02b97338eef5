"""Where a knee stands without shear: what fixes the pose parameters that nothing else does."""

from __future__ import annotations

import numpy as np

from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.statics import settle
from casadi_contact.structures import Surrogate
from problems.muscle_walk import MuscleWalk

NEUTRAL_LOAD_N = 500.0


def neutral_poses(surrogate: Surrogate, walk: MuscleWalk) -> Array:
    """Poses (n, 6) at the walk's ry and rz where equal forces on both sides cause no shear, Fx = Fz = 0.

    Raises ValueError where rotations lie outside what the surrogate learned, or there is no such pose.
    """
    ranges = surrogate.record.get("pose_range", {})
    poses = np.zeros((len(walk), 6))
    for name in POSE_NAMES:
        low, high = ranges.get(name, (-np.inf, np.inf))
        column = poses[:, POSE_NAMES.index(name)]
        column[:] = 0.5 * (low + high) if np.isfinite(low + high) else 0.0
        if name in ("ry", "rz"):
            column[:] = getattr(walk, name)
            if column.min() < low or column.max() > high:
                raise ValueError(
                    f"walk {walk.name}: {name} reaches from {column.min():.3g} to {column.max():.3g} rad, the "
                    f"surrogate learned {low:.3g} to {high:.3g}: train one around your own cycles"
                )
    load = -NEUTRAL_LOAD_N
    targets = {"Fy_med": load, "Fy_lat": load, "Fx": 0.0, "Fz": 0.0}
    poses, _ = settle(surrogate, poses, ("ty", "rx"), {"Fy_med": load, "Fy_lat": load}, tolerance=1.0)
    poses, report = settle(surrogate, poses, ("tx", "ty", "tz", "rx"), targets, tolerance=0.1)
    if not report.converged.all():
        frame = int(np.argmin(report.converged))
        raise ValueError(f"walk {walk.name}, frame {frame} has no neutral pose: {report.reason[frame]}")
    return poses
