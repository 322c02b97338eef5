"""Poses in which a patch is pressed: what the size of its cells is chosen on."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.approach import press_until, trace_gap
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import POSE_NAMES, Array, rotation
from casadi_contact.scenes.joint_cycle import scene_cycles
from casadi_contact.scenes.scene import Scene

_TURN_RAD = np.deg2rad([10.0, 15.0, 60.0])  # to both sides, where no motion is told: joints flex about z
_BEYOND_RAD = np.deg2rad(10.0)  # beyond a motion that the scene tells
_LEAN_RAD = np.deg2rad(20.0)
SEATED = 12  # poses of a patch
_SHARE = 0.15  # of the patch's extent, by which the body is shifted to each side
_LIFT_MM = 300.0
_STEPS = 100
_NEAR_MM = 0.01
_ROUNDS = 6
_LEAST_SHARE, _MOST = 0.5, 2.0  # of the force target, in poses that are kept


def pressed_poses(model: ElasticFoundation, patch: int, loads_n: tuple[float, float], count: int) -> Array:
    """Poses (m, 6), m <= count, that press one patch of a model, each found from a random one.

    From the scene's start pose the body is turned about the patch's anchor, as far as the scene's motion and a little
    more where it tells one, and, by turns, shifted and brought down along the patch's mean normal until it touches, or
    brought down along a direction that leans from it; then it presses with forces spread evenly on a logarithmic scale
    between loads_n [N]. Where it comes down beside the patch there is no pose.
    """
    random = np.random.default_rng(0)
    turn, lean, shift = random.random((3, count, 1)) * random.uniform(-1.0, 1.0, (3, count, 3))
    straight = np.arange(count)[:, None] % 2
    target = random.permutation(np.geomspace(*loads_n, count))
    return _pressed(model, patch, turn, (1 - straight) * lean, straight * shift, target)


def seated_poses(model: ElasticFoundation, patch: int, loads_n: tuple[float, float]) -> Array:
    """Poses (m, 6), m <= `SEATED`, that press one patch as the scene's start pose does, brought straight down with
    forces from the least to the largest of loads_n [N]: half of them as it is, half turned from end to end of the
    scene's motion about the axis that it turns about the most. In an embracing patch a body that is shifted or turned
    otherwise hangs on the walls."""
    half, (middle, most) = SEATED // 2, _turns_rad(model.scene)
    turn, still = np.zeros((SEATED, 3)), np.zeros((SEATED, 3))
    turn[:half] = (model.scene.start_pose[3:] - middle) / most
    turn[half:, most.argmax()] = np.linspace(-1.0, 1.0, half)
    return _pressed(model, patch, turn, still, still, np.tile(np.geomspace(*loads_n, half), 2))


def _pressed(model: ElasticFoundation, patch: int, turn: Array, lean: Array, shift: Array, target: Array) -> Array:
    """Poses (m, 6) of bodies turned, leaning and shifted (n, 3), as shares of what `pressed_poses` allows, that press
    the patch with about the forces target (n,) [N]."""
    elements = model.scene.elements(model.grid)[patch]
    points, up = elements.centres_mm, elements.areas_mm2 @ elements.normals
    up /= np.linalg.norm(up)
    away = up + np.tan(_LEAN_RAD) * lean
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    shift = _SHARE * shift * np.ptp(points, axis=0)
    poses = np.tile(model.scene.start_pose, (len(target), 1))
    before = rotation(poses[:, 3:])
    middle, most = _turns_rad(model.scene)
    poses[:, 3:] = middle + most * turn
    poses[:, :3] += (before - rotation(poses[:, 3:])) @ model.scene.anchors_mm[patch]
    poses[:, :3] += shift - (shift @ up)[:, None] * up

    def moved(rows: np.ndarray, lift_mm: Array) -> Array:
        after = poses[rows]
        after[:, :3] += lift_mm[:, None] * away[rows]
        return after

    def gap_at(rows: np.ndarray, travel_mm: Array) -> Array:
        return model.gaps(moved(rows, _LIFT_MM - travel_mm))[:, patch]

    travel, touching = trace_gap(
        gap_at, len(poses), reach_mm=2.0 * _LIFT_MM, touch_mm=_NEAR_MM, share=0.9, most_steps=_STEPS
    )
    poses = moved(np.arange(len(poses)), _LIFT_MM - travel)[touching]
    away, target = away[touching], target[touching]

    def at(depth_mm: Array) -> Array:
        return np.column_stack([poses[:, :3] - depth_mm[:, None] * away, poses[:, 3:]])

    depth, force = press_until(
        lambda depth_mm: np.linalg.norm(model.wrenches(at(depth_mm))[:, patch, :3], axis=1), target, 0.05, _ROUNDS
    )
    return at(depth)[(force > _LEAST_SHARE * target) & (force < _MOST * target)]


def _turns_rad(scene: Scene) -> tuple[Array, Array]:
    """Middle (3,) and half (3,) of the angles rx, ry, rz that the body is turned by."""
    middle, most = scene.start_pose[3:].copy(), _TURN_RAD.copy()
    told = [cycle.pose for cycle in scene_cycles(scene)] if scene.motion else [{}]
    for k, name in enumerate(POSE_NAMES[3:]):
        if name in told[0]:
            angles = np.array([pose[name] for pose in told])
            middle[k] = 0.5 * (angles.min() + angles.max())
            most[k] = 0.5 * np.ptp(angles) + _BEYOND_RAD
    return middle, most
