"""Poses that press one patch of a scene, as elements see them: those that a size of cells is chosen for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.approach import press_until, trace_gap
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import POSE_NAMES, Array, rotation
from casadi_contact.scenes.joint_cycle import scene_cycles
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class PressingPoses:
    """How poses that press a patch are drawn and found."""

    turn_deg: tuple[float, float, float] = (10.0, 15.0, 60.0)  # to both sides, in a scene without a motion
    beyond_deg: float = 10.0  # beyond the motion of a scene that has one
    lean_deg: float = 20.0  # of the direction that the body comes down along
    shift_share: float = 0.15  # of the patch's extent, to each side
    seats: int = 12  # poses of a patch as in the scene's start pose
    lift_mm: float = 300.0  # from where the body comes down
    touch_mm: float = 0.01
    most_steps: int = 100
    rounds: int = 6  # of pressing
    kept: tuple[float, float] = (0.5, 2.0)  # least and largest force of poses that are kept, over the target

    def pressed(self, model: ElasticFoundation, patch: int, loads_n: tuple[float, float], count: int) -> Array:
        """Poses (m, 6), m <= count, that press one patch of a model, each found from a random one.

        From the scene's start pose the body is turned about the patch's anchor, a little farther than in the scene's
        motion if it has one. By turns it is shifted and brought down along the patch's mean normal until it touches, or
        brought down along a direction that leans from it. Then it presses with forces spread evenly on a logarithmic
        scale between loads_n [N]. There is no pose where it comes down beside the patch.
        """
        random = np.random.default_rng(0)
        turn, lean, shift = random.random((3, count, 1)) * random.uniform(-1.0, 1.0, (3, count, 3))
        straight = np.arange(count)[:, None] % 2
        target = random.permutation(np.geomspace(*loads_n, count))
        return self._pressed(model, patch, turn, (1 - straight) * lean, straight * shift, target)

    def seated(self, model: ElasticFoundation, patch: int, loads_n: tuple[float, float]) -> Array:
        """Poses (m, 6), m <= `seats`, that press one patch as the scene's start pose does: brought straight down with
        forces from the least to the largest of loads_n [N].

        Half of them are not turned, half are turned from end to end of the scene's motion about its main axis. In an
        embracing patch a body that is shifted or turned otherwise hangs on the walls.
        """
        half, (middle, most) = self.seats // 2, self._turns_rad(model.scene)
        turn, still = np.zeros((self.seats, 3)), np.zeros((self.seats, 3))
        turn[:half] = (model.scene.start_pose[3:] - middle) / most
        turn[half:, most.argmax()] = np.linspace(-1.0, 1.0, half)
        return self._pressed(model, patch, turn, still, still, np.tile(np.geomspace(*loads_n, half), 2))

    def _pressed(
        self, model: ElasticFoundation, patch: int, turn: Array, lean: Array, shift: Array, target: Array
    ) -> Array:
        """Poses (m, 6) of bodies turned, leaning and shifted (n, 3), as shares of what `pressed` allows, that press
        the patch with about the forces target (n,) [N]."""
        elements = model.scene.elements(model.grid)[patch]
        points, up = elements.centres_mm, elements.areas_mm2 @ elements.normals
        up /= np.linalg.norm(up)
        away = up + np.tan(np.deg2rad(self.lean_deg)) * lean
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        shift = self.shift_share * shift * np.ptp(points, axis=0)
        poses = np.tile(model.scene.start_pose, (len(target), 1))
        before = rotation(poses[:, 3:])
        middle, most = self._turns_rad(model.scene)
        poses[:, 3:] = middle + most * turn
        poses[:, :3] += (before - rotation(poses[:, 3:])) @ model.scene.anchors_mm[patch]
        poses[:, :3] += shift - (shift @ up)[:, None] * up

        def moved(rows: np.ndarray, lift_mm: Array) -> Array:
            after = poses[rows]
            after[:, :3] += lift_mm[:, None] * away[rows]
            return after

        def gap_at(rows: np.ndarray, travel_mm: Array) -> Array:
            return model.gaps(moved(rows, self.lift_mm - travel_mm))[:, patch]

        reach_mm, count = 2.0 * self.lift_mm, len(poses)
        travel, touching = trace_gap(
            gap_at, count, reach_mm=reach_mm, touch_mm=self.touch_mm, share=0.9, most_steps=self.most_steps
        )
        poses = moved(np.arange(len(poses)), self.lift_mm - travel)[touching]
        away, target = away[touching], target[touching]

        def at(depth_mm: Array) -> Array:
            return np.column_stack([poses[:, :3] - depth_mm[:, None] * away, poses[:, 3:]])

        def force_at(depth_mm: Array) -> Array:
            return np.linalg.norm(model.wrenches(at(depth_mm))[:, patch, :3], axis=1)

        depth, force = press_until(force_at, target, 0.05, self.rounds)
        return at(depth)[(force > self.kept[0] * target) & (force < self.kept[1] * target)]

    def _turns_rad(self, scene: Scene) -> tuple[Array, Array]:
        """Middle (3,) and half (3,) of the angles rx, ry, rz that the body is turned by."""
        middle, most = scene.start_pose[3:].copy(), np.deg2rad(self.turn_deg)
        cycles = [cycle.pose for cycle in scene_cycles(scene)] if scene.motion else [{}]
        for k, name in enumerate(POSE_NAMES[3:]):
            if name in cycles[0]:
                angles = np.array([pose[name] for pose in cycles])
                middle[k] = 0.5 * (angles.min() + angles.max())
                most[k] = 0.5 * np.ptp(angles) + np.deg2rad(self.beyond_deg)
        return middle, most
