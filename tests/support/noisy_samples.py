"""Samples of a made-up truth: a known surrogate plus known noise on a known region of poses."""

import numpy as np

from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD

SCENE = load_scene("sphere_on_plane")
NOISE = 0.02


def made_up_samples(surrogate, count=6000, noise=NOISE, seed=0):
    """Poses on a curved tube in tx and rz; wrenches of the surrogate times (1 + noise)."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-1.0, 1.0, (count, 6))
    unit[:, 0] = 2.0 * unit[:, 5] ** 2 - 1.0 + 0.1 * unit[:, 0]
    poses = POSE_CENTRE + POSE_SPREAD * unit
    wrenches = surrogate.wrenches(poses) * (1.0 + noise * rng.standard_normal((count, 1, 1)))
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.6, 0.2, 0.2]).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    return Samples(SCENE, poses, wrenches, np.full((count, 1), np.nan), domain, role)
