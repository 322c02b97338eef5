"""Samples and regressions whose targets are smooth functions of the pose, for tests of training."""

import numpy as np

from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene

SPHERE = load_scene("sphere_on_plane")
CENTRE = np.array([0.0, 29.9, 0.0, 0.0, 0.1, -0.2])
SPREAD = np.array([4.0, 0.05, 3.0, 0.1, 0.2, 0.4])


def smooth_wrenches(poses):
    """Pressing everywhere (Fy from -1500 to -500 N), the other components of either sign."""
    u = (poses - CENTRE) / SPREAD
    wrenches = np.zeros((len(poses), 1, 6))
    wrenches[:, 0, 1] = -1000.0 + 300.0 * np.sin(u[:, 1]) * np.cos(0.5 * u[:, 0]) + 100.0 * u[:, 2] * u[:, 5] / 2.0
    wrenches[:, 0, 0] = 40.0 * np.sin(u[:, 0]) + 20.0 * u[:, 3]
    wrenches[:, 0, 3] = 5000.0 * np.cos(u[:, 2]) * u[:, 4]
    return wrenches


def smooth_poses(count, seed=0):
    return CENTRE + SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6))


def smooth_samples(count=600, wrenches=smooth_wrenches, seed=0):
    """Training samples, with one validation and one test sample in ten."""
    poses = smooth_poses(count, seed)
    role = np.full(count, TRAIN, dtype=np.uint8)
    role[::10], role[5::10] = VALIDATION, TEST
    domain = np.where(np.arange(count) % 3, 1, 2).astype(np.uint8)
    return Samples(SPHERE, poses, wrenches(poses), np.zeros((count, 1)), domain, role)


NAMES = ("Fy", "Fx", "Tx")


FIXED = TrainingSettings(sizes=((6, 5),), max_iterations=40)  # ends by iterations, the same on any machine
GROWING = TrainingSettings(sizes=((2,), (4,), (5, 5), (6, 6, 6)), max_iterations=160)


def smooth(rows=400, seed=0, tolerance=0.0, name="smooth") -> Regression:
    """A smooth function of three inputs, weights spread over a factor of 50, a fifth of the rows for validation."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (rows, 3)) * (1.0, 5.0, 0.2) + (0.0, 27.0, 0.0)
    y = np.sqrt(1.5 + x[:, 0] * np.cos(0.4 * (x[:, 1] - 27.0)) * 0.9) + 3.0 * x[:, 2] ** 2
    weights = rng.uniform(2.0, 100.0, rows)
    return Regression(name, x, y, weights, rng.random(rows) < 0.2, tolerance)
