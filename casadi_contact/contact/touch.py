"""The first touch: where a body meets the other one on its way into contact."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array, rotation

_ABOVE_MM = 1000.0
_TOUCH_MM = 1e-3
_STEPS = 200


def first_touch(model: ContactModel, poses: Array, wanted: Mapping[str, Array]) -> Array:
    """Poses (n, 6) moved towards the patches until the first touch: from far away along the direction in which these
    are pressed, or, where a normal load has none, from where they are along the wanted force (n,) by load names; within
    the scene's pose space.

    Steps of the smallest gap do not pass the surface (sphere tracing); where a gap that is only estimated from far away
    led too deep, half of the way since the last free pose is taken back. A pose that overlaps at first stays. Raises
    ValueError for a model without gaps and for a scene without direction whose force is not among the wanted loads.
    """
    gaps = getattr(model, "gaps", None)
    if gaps is None:
        raise ValueError("this contact model has no gaps(poses), expected a start pose in contact")
    poses, space = poses.copy(), model.scene.pose_space
    along, direction = ways_of_pressing(model, len(poses), wanted), model.scene.normal_loads[0].direction
    if direction is not None:
        axis = int(np.abs(direction).argmax())
        poses[:, axis] = -_ABOVE_MM * direction[axis]
    since_free = np.zeros(len(poses))  # way that led from a free pose to this one [mm]
    for _ in range(_STEPS):
        gap = gaps(space.onto(poses)).min(axis=1)
        since_free = np.where(gap >= 0.0, 0.0, since_free)
        step = np.where(gap < -_TOUCH_MM, -0.5 * since_free, np.maximum(gap, 0.0))
        if np.abs(step).max() < _TOUCH_MM:
            break
        poses[:, :3] += step[:, None] * along
        since_free += step
    return space.onto(poses)


def ways_of_pressing(model: ContactModel, count: int, wanted: Mapping[str, Array]) -> Array:
    """Unit vectors (count, 3) along which bodies go into contact: that of the first patch, or where its normal load has
    none along the wanted force. Raises ValueError where that is not among the wanted loads."""
    normal = model.scene.normal_loads[0]
    if normal.direction is not None:
        return np.tile(normal.direction, (count, 1))
    missing = [name for name in normal.loads if name not in wanted]
    if missing:
        raise ValueError(f"there is no load {', '.join(missing)}, expected the force that presses the patch")
    along: Array = np.stack([wanted[name] for name in normal.loads], axis=1)
    return along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)


def touching_start(model: ContactModel) -> Array:
    """The first touch (6,) from the scene's start pose; that pose itself where patches are pressed in no single
    direction, and for a model without gaps."""
    start = model.scene.pose_space.onto(model.scene.start_pose)
    directed = model.scene.normal_loads[0].direction is not None
    return first_touch(model, start[None], {})[0] if directed and hasattr(model, "gaps") else start


def turned_about_anchors(model: ContactModel, start: Array, poses: Array) -> Array:
    """Poses (n, 6) that keep their rotations, moved so that the middle of the patches' anchors lies where it does in a
    start pose (6,): a body whose origin is far from where it touches leaves its socket when that is turned about."""
    middle, poses = model.scene.anchors_mm.mean(axis=0), poses.copy()
    poses[:, :3] = start[:3] + (rotation(start[3:]) - rotation(poses[:, 3:])) @ middle
    return poses
