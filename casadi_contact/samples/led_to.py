"""Poses to which a surrogate itself leads: settled on it, from anywhere in the sampled range."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.models import model_name_of
from casadi_contact.samples.perturbed import LEAST_VALIDITY, label_poses
from casadi_contact.samples.samples import TEST, TRAIN, Samples

_MOST, _MOST_OF_OWN = 40_000, 2_000  # of a model of the library's; of a user's own, which may be slow
_LIGHT = 0.25  # share of the poses whose loads are lighter: every contact begins and ends so
_TOLERANCE_N = 1e-2
_ITERATIONS = 40


def samples_led_to(
    surrogate: ContactModel,
    samples: Samples,
    model: WrenchModel,
    validity: Callable[[Array], Array] | None = None,
    *,
    count: int | None = None,
    seed: int = 17,
    progress: Progress | None = None,
) -> Samples:
    """`poses_led_to` with the contact model's loads, those whose contact runs off the elements too: where an insert's
    rim is passed, the surrogate is wrong. Roles are those of `perturbed_samples`. progress(done, all) is called as
    poses settle, which counts for half, and as the model is evaluated.

    validity (n,) of poses (n, 6): a user's own model, which may fail far off, is asked where it is above 0.1 alone.
    count: at most so many; as many as the samples if left out, and no more than 40,000 (2,000 of a user's own model).
    """
    own = model_name_of(samples) is None
    if count is None:
        count = min(len(samples), _MOST_OF_OWN if own else _MOST)
    settling, evaluating = (None if progress is None else _half(progress, number) for number in range(2))
    poses = poses_led_to(surrogate, samples, count=count, seed=seed, progress=settling)
    if own and validity is not None:
        poses = poses[validity(poses) > LEAST_VALIDITY]
    return label_poses(model, samples.scene, poses, evaluating, rim=True)


def _half(progress: Progress, number: int) -> Progress:
    """What tells how far the first (0) or second (1) half of some work is."""
    return lambda done, total: progress(number * total + done, 2 * total)


def poses_led_to(
    surrogate: ContactModel, samples: Samples, *, count: int, seed: int = 17, progress: Progress | None = None
) -> Array:
    """Poses (m, 6), m <= count, at which the surrogate carries normal loads of training samples, in a quarter of them a
    share u³ of these, u drawn evenly from 0 to 1.

    Starts lie evenly over the range of the samples that are not test rows. Each patch (all together, where they share
    one sensitive pose parameter) is to carry its normal load of a training sample that presses it, another one for each
    patch; the scene's sensitive pose parameters settle on the surrogate. No pose is found for a surrogate that does not
    give all of these loads.
    """
    scene, rng = samples.scene, np.random.default_rng(seed)
    training, known = samples.select(role=TRAIN), samples.poses[samples.role != TEST]
    wanted: dict[str, Array] = {}
    for load in scene.pressed:
        values = training.loads(load.loads)
        values = values[(values != 0.0).any(axis=1)]
        if len(values):
            wanted |= zip(load.loads, values[rng.integers(len(values), size=count)].T, strict=True)
    if len(wanted) != len(scene.sensitive_pose) or not wanted or not set(wanted) <= set(surrogate.load_names):
        return np.empty((0, 6))
    shares = np.where(rng.random(count) < _LIGHT, rng.random(count) ** 3, 1.0)
    wanted = {name: shares * load for name, load in wanted.items()}
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
