"""Poses drawn evenly over the whole sampled range, with a contact model's loads: where a user's own poses may lie.

Samples lie where loads were asked for. Within the ranges of their pose parameters there are poses that press towards
another side, or lie farther from the next sample, than any of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.around import samples_at
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.draw import model_name_of
from casadi_contact.samples.samples import TEST, Samples

# At most, and a third as many as the samples; of a user's own model, which may be slow. Of 250 pressed ones that an
# expected error was fitted to it held 97 % of the errors, and 91 % of others.
_MOST, _MOST_OF_OWN = 6000, 2000
MOST_DRAWN = 200  # times as many poses, of which too few may be valid
ASKED_FROM_VALIDITY = 0.1  # so that the edge of the learned region can be learned from both of its sides
_AT_ONCE = 20_000  # poses


def samples_in_range(
    samples: Samples,
    model: WrenchModel,
    validity: Callable[[Array], Array],
    roots: Callable[[Array], Array],
    *,
    count: int | None = None,
    seed: int = 13,
    progress: Progress | None = None,
) -> Samples:
    """Poses within the range of the samples that are not test rows, of a validity above 0.1, and the model's loads.

    validity (n,) and root loads (n, P) of poses (n, 6) are a surrogate's; where one is above zero a patch is pressed.
    Half of the poses are pressed, as far as `MOST_DRAWN` times as many hold them: chance seldom presses. Roles, poses
    that are dropped, and progress are those of `samples_around`. Raises ValueError where all samples are test rows.
    """
    if count is None:
        count = most_in_range(samples)
    rng = np.random.default_rng(seed)
    halves: tuple[list[Array], list[Array]] = [], []
    wanted = (count // 2, count - count // 2)
    for _ in range(0, max(MOST_DRAWN * count, 1), _AT_ONCE):
        poses = poses_in_range(samples, _AT_ONCE, rng)
        poses = poses[validity(poses) > ASKED_FROM_VALIDITY]
        pressed = (roots(poses) > 0.0).any(axis=1)
        for half, most, rows in zip(halves, wanted, (pressed, ~pressed), strict=True):
            half.extend(poses[rows][: most - len(half)])
        if all(len(half) == most for half, most in zip(halves, wanted, strict=True)):
            break
    return samples_at(model, samples.scene, np.array([*halves[0], *halves[1]]).reshape(-1, 6), progress)


def most_in_range(samples: Samples) -> int:
    """How many poses `samples_in_range` draws where nothing else is said."""
    return min(len(samples) // 3, _MOST_OF_OWN if model_name_of(samples) is None else _MOST)


def poses_in_range(samples: Samples, count: int, rng: np.random.Generator) -> Array:
    """Poses (count, 6) drawn evenly over the range of the samples that are not test rows, on the scene's pose space;
    raises ValueError where all are."""
    known = samples.poses[samples.role != TEST]
    if not len(known):
        raise ValueError(f"{len(samples)} samples, all of them test rows, expected some that were learned: no range")
    return samples.scene.pose_space.onto(known.min(axis=0) + np.ptp(known, axis=0) * rng.random((count, 6)))
