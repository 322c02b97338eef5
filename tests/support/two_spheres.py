"""A contact model in closed form: two spheres under the moving body's anchors on the plane y = 0.

A sphere of radius r with its centre at c = t + R(q)·a carries N = k·max(r - c_y, 0)² at (c_x, 0, c_z).
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import cache

import numpy as np

from casadi_contact.contact.model import WrenchLoads
from casadi_contact.core.conventions import angular_velocity_map, as_poses, rotation
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.reference import ReferenceMotion, reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.loading import load_scene

RADIUS_MM = 27.0
STIFFNESS = 8.0e4  # N/mm²


class TwoSpheres(WrenchLoads):
    def _centres(self, poses):
        """Centres (n, P, 3) and their derivatives by the pose (n, P, 3, 6)."""
        arms = np.einsum("nij,pj->npi", rotation(poses[:, 3:]), self.scene.anchors_mm)
        slopes = np.zeros((*arms.shape, 6))
        slopes[..., :3] = np.eye(3)
        axes = angular_velocity_map(poses[:, 3:])
        for k in range(3):
            slopes[..., 3 + k] = np.cross(axes[:, None, :, k], arms)
        return poses[:, None, :3] + arms, slopes

    def wrench_jacobian(self, poses):
        c, dc = self._centres(as_poses(poses))
        depth = np.maximum(RADIUS_MM - c[..., 1], 0.0)
        N, dN = STIFFNESS * depth**2, -2.0 * STIFFNESS * depth[..., None] * dc[..., 1, :]
        w, dw = np.zeros((*N.shape, 6)), np.zeros((*N.shape, 6, 6))
        for component, arm, sign in ((3, 2, 1.0), (5, 0, -1.0)):  # Tx = z·N, Tz = -x·N
            w[..., component] = sign * c[..., arm] * N
            dw[..., component, :] = sign * (c[..., arm, None] * dN + N[..., None] * dc[..., arm, :])
        w[..., 1], dw[..., 1, :] = -N, -dN
        return w, dw

    def wrenches(self, poses):
        return self.wrench_jacobian(poses)[0]

    def gaps(self, poses):
        return self.gap_jacobian(as_poses(poses))[0]

    def gap_jacobian(self, poses):
        c, dc = self._centres(poses)
        return c[..., 1] - RADIUS_MM, dc[..., 1, :]


def models(scene, settings):
    """A pair of models for draw_samples, importable by worker processes."""
    return TwoSpheres(scene), TwoSpheres(scene)


def cycles(model, count=3):
    """Cycles made from known poses (count, 21, 6): loads are the model's own at those poses."""
    t = np.linspace(0.0, 1.0, 21)
    made, poses = [], np.zeros((count, len(t), 6))
    for k in range(count):
        p = poses[k]
        p[:, 0] = 2.0 * np.sin(2 * np.pi * t + 0.3 * k) + 0.2 * k
        p[:, 1] = RADIUS_MM - 0.08 - 0.01 * k + 0.02 * np.cos(2 * np.pi * t)
        p[:, 2] = 0.5 * np.cos(2 * np.pi * t) * (1 + 0.2 * k)
        p[:, 3] = 4e-4 * np.sin(4 * np.pi * t) * (1 + 0.1 * k)
        p[:, 4] = 0.05 * np.sin(2 * np.pi * t)
        p[:, 5] = -0.6 + 0.5 * np.cos(2 * np.pi * t) + 0.05 * k
        loads = dict(zip(model.load_names, model(p).T, strict=True))
        wanted = {name: loads[name] for name in ("Fy_med", "Fy_lat", "Tx", "Tz")}
        made.append(Cycle(f"cycle {k}", t * (1.0 + 0.1 * k), {"ry": p[:, 4], "rz": p[:, 5]}, wanted))
    return made, poses


def knee():
    return load_scene("knee")


SETTINGS = SamplingSettings(scale=0.003, frames=21, chunk_size=20, seed=5)


@cache
def sphere_motion() -> ReferenceMotion:
    """The reference motion that samples are drawn around."""
    model = TwoSpheres(knee())
    return reference_motion(model, cycles(model)[0], SETTINGS)[0]


def draw(path, executor=None, *, settings=SETTINGS, motion=None, models=models, **options):
    """Draw the samples into a file, as `draw_samples`, in this process where no executor is given."""
    motion = sphere_motion() if motion is None else motion
    with nullcontext(executor) if executor else ThreadPoolExecutor(1) as workers:
        return draw_samples(knee(), motion, path, settings=settings, executor=workers, models=models, **options)
