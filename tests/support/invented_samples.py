"""Samples of the knee with invented loads, for training targets and files alone."""

import numpy as np

from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene
from tests.support.random_surrogates import random_poses

KNEE = load_scene("knee")


def invented_samples(count=300, seed=0) -> Samples:
    """Each side 40 % lifted, ratios that are simple functions of the pose."""
    rng = np.random.default_rng(seed)
    poses, gaps = random_poses(count, seed), rng.uniform(-0.1, 0.15, (count, 2))
    normal = np.where(gaps < 0.0, 8e4 * gaps**2, 0.0)
    ratios = np.array([0.05, -1.0, 0.03, 22.0, 1.0, -4.0])
    wrenches = normal[:, :, None] * np.stack([ratios, ratios * [1, 1, -1, -1, 1, 1]])
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.8, 0.1, 0.1]).astype(np.uint8)
    return Samples(KNEE, poses, wrenches, gaps, np.ones(count, dtype=np.uint8), role)
