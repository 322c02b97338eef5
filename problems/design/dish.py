"""Contact in dishes whose radii are inputs: loads and largest depths with exact first derivatives."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from casadi_contact.contact.polar.dish_slopes import RADII, dish_slopes
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.polar.quadrature import patch_loads
from casadi_contact.contact.polar.surfaces import Torus
from casadi_contact.contact.symbolic import contact_callback
from casadi_contact.core.conventions import Array, by_pose, load_selection, rotation, twist
from casadi_contact.scenes.scene import Scene

RAYS = Rays(24, 3)


class DishContact:
    """Loads and largest depths of a knee's sides as functions of poses and of the radii (sagittal, frontal) [mm] that
    both dishes have. Raises ValueError for a scene of another shape, and for one whose sides have radii of their own.
    """

    def __init__(self, scene: Scene, rays: Rays = RAYS) -> None:
        if scene.shape != "knee" or any(name in scene.geometry.get(p, {}) for p in scene.patch_names for name in RADII):
            raise ValueError(
                f"scene {scene.name} has the shape {scene.shape}, expected a knee with the same dish on both sides"
            )
        self.scene, self.rays = scene, rays
        self.load_names, self.patch_names = scene.load_names, scene.patch_names
        self._model = PolarFoundation(scene, rays, compiled=False)
        self._selection = load_selection(self.load_names, self.patch_names)

    @property
    def radii_mm(self) -> Array:
        """The scene's own radii (2,)."""
        return np.array([self.scene.geometry[name] for name in RADII])

    def with_radii(self, radii_mm: Array) -> Scene:
        """The scene with other dishes; raises ValueError for radii that no knee has."""
        return self.scene.with_overrides(**dict(zip(RADII, map(float, radii_mm), strict=True)))

    def evaluate(self, poses: Array, radii_mm: Array) -> tuple[Array, Array]:
        """Loads, then largest depths of the sides (n, L + P) [N, N·mm, mm], and their derivatives by pose and radii
        (n, L + P, 8)."""
        sagittal, frontal = map(float, radii_mm)
        torus = Torus(sagittal - frontal, frontal, sagittal, 1.0, -1.0)
        R, t, law = rotation(poses[:, 3:]), poses[:, :3], self._model.law
        L = len(self.load_names)
        values = np.zeros((len(poses), L + len(self.patch_names)))
        slopes = np.zeros((*values.shape, 8))
        for p, patch in enumerate(self._model.patches):
            dish = replace(patch, torus=torus)
            loads = patch_loads(dish, law, self.rays, R, t)
            by_radii, there, deepest_by_radii = dish_slopes(dish, law, self.rays, R, t)
            touching = there.depth > 0.0
            by_twist = -twist(there.ends.G, there.ends.x - t) / there.ends.slope[:, None]
            rows = self._selection[:, p]
            values[:, :L] += loads.wrench @ rows.T
            slopes[:, :L, :6] += rows @ by_pose(loads.stiffness, poses)
            slopes[:, :L, 6:] += rows @ by_radii
            values[:, L + p] = np.where(touching, there.depth, 0.0)
            slopes[:, L + p, :6] = touching[:, None] * by_pose(by_twist, poses)
            slopes[:, L + p, 6:] = deepest_by_radii
        return values, slopes

    def function(self, poses: int) -> ca.Function:
        """casadi.Function (all poses, pose after pose, then the radii) (6n + 2) -> loads and depths (n·(L + P)), pose
        after pose, with their Jacobian: one call for all, because NumPy evaluates many poses at the price of one."""
        rows = poses * (len(self.load_names) + len(self.patch_names))

        @lru_cache(maxsize=1)  # IPOPT asks for values and derivatives at one point in turn
        def at(numbers: bytes) -> tuple[Array, Array]:
            point = np.frombuffer(numbers)
            values, slopes = self.evaluate(point[:-2].reshape(poses, 6), point[-2:])
            whole = np.zeros((poses, values.shape[1], len(point)))
            for k in range(poses):
                whole[k, :, 6 * k : 6 * k + 6] = slopes[k, :, :6]
            whole[:, :, -2:] = slopes[:, :, 6:]
            return values.reshape(1, -1), whole.reshape(1, rows, -1)

        return contact_callback(
            "dish_contact", [("loads_and_depths", rows, lambda points: at(points.tobytes()))], 6 * poses + 2
        )
