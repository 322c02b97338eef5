"""Poses to which a surrogate itself leads: settled on it, from anywhere in the sampled range."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact import ContactModel
from casadi_contact.conventions import Array, Progress
from casadi_contact.dataset import TEST, TRAIN, Samples
from casadi_contact.statics import settle

LED_COUNTS = (40_000, 2_000)  # at most, of a model of the library's and of a user's own, which may be slow
_TOLERANCE_N = 1e-2
_ITERATIONS = 40


def poses_led_to(
    surrogate: ContactModel, samples: Samples, *, count: int, seed: int = 17, progress: Progress | None = None
) -> Array:
    """Poses (m, 6), m <= count, at which the surrogate carries normal loads of training samples.

    Starts lie evenly over the range of the samples that are not test rows. Each patch is to carry its normal load of a
    training sample that presses it, another one for each patch; the scene's sensitive pose parameters settle on the
    surrogate. No pose is found for a scene with another number of such parameters than of normal loads.
    """
    scene, rng = samples.scene, np.random.default_rng(seed)
    training, known = samples.select(role=TRAIN), samples.poses[samples.role != TEST]
    wanted: dict[str, Array] = {}
    for load in scene.normal_loads:
        values = training.loads(load.loads)
        values = values[(values != 0.0).any(axis=1)]
        if len(values):
            wanted |= zip(load.loads, values[rng.integers(len(values), size=count)].T, strict=True)
    if len(wanted) != len(scene.sensitive_pose) or not wanted:
        return np.empty((0, 6))
    starts = known.min(axis=0) + np.ptp(known, axis=0) * rng.random((count, 6))
    poses, report = settle(
        surrogate,
        scene.pose_space.onto(starts),
        scene.sensitive_pose,
        wanted,
        tolerance=_TOLERANCE_N,
        max_iterations=_ITERATIONS,
        trust_region=False,
        progress=progress,
    )
    return poses[report.converged]
