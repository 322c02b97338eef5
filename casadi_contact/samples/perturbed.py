"""Poses besides the plan, with a contact model's loads: moved out of equilibrium, or uniform over the sampled range.

Samples lie where loads were wanted. An optimiser's steps and a user's own poses lie between and beside them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.chunk import WrenchModel, part_wrenches, reaches_edge
from casadi_contact.samples.models import model_name_of
from casadi_contact.samples.samples import TEST, VALIDATION, Dropped, Samples
from casadi_contact.scenes.scene import Scene

LEAST_VALIDITY = 0.1  # of poses that are evaluated: the edge of the valid region is then learned from both sides


def perturbed_samples(
    samples: Samples,
    model: WrenchModel,
    *,
    count: int | None = None,
    move_mm: float = 1.0,
    move_rad: float = float(np.deg2rad(2.0)),
    seed: int = 12,
    progress: Progress | None = None,
) -> Samples:
    """Poses of D1 moved by up to move_mm and move_rad in every parameter, and the model's loads there.

    count: a third of the samples, 4,000 to 40,000, if left out. Half of the moves are uniform, half normal with these
    deviations, and a quarter of all are shortened at random. Rows are validation and test in turn. Poses whose contact
    runs off the elements, and those without finite loads, are dropped. progress(done, all): poses evaluated.
    """
    rng = np.random.default_rng(seed)
    if count is None:
        count = int(np.clip(len(samples) // 3, 4000, 40_000))
    known = samples.select("D1").poses
    if not len(known):
        known = samples.poses
    if not len(known):
        raise ValueError("samples hold no row, expected some thousands: draw them first")
    poses = known[rng.integers(len(known), size=count)]
    moves = np.where(rng.random((count, 1)) < 0.5, rng.uniform(-1.0, 1.0, (count, 6)), rng.standard_normal((count, 6)))
    shortened = np.where(rng.random((count, 1)) < 0.25, rng.random((count, 1)), 1.0)
    poses = samples.scene.pose_space.onto(poses + shortened * moves * np.repeat([move_mm, move_rad], 3))
    return label_poses(model, samples.scene, poses, progress)


def uniform_samples(
    samples: Samples,
    model: WrenchModel,
    validity: Callable[[Array], Array],
    roots: Callable[[Array], Array],
    *,
    count: int | None = None,
    most_drawn: int = 200,
    seed: int = 13,
    progress: Progress | None = None,
) -> Samples:
    """Poses uniform in the range of the samples, with a validity above `LEAST_VALIDITY`, and the model's loads.

    validity (n,) and root loads (n, P) of poses (n, 6) are a surrogate's; a root load above zero is contact. Half of
    the poses are in contact, as far as most_drawn·count random poses contain so many. Roles, dropped poses and
    progress as in `perturbed_samples`. Raises ValueError where all samples are test rows.
    """
    if count is None:
        count = uniform_count(samples)
    rng, at_once = np.random.default_rng(seed), 20_000
    halves: tuple[list[Array], list[Array]] = [], []
    sizes = (count // 2, count - count // 2)
    for _ in range(0, max(most_drawn * count, 1), at_once):
        poses = uniform_poses(samples, at_once, rng)
        poses = poses[validity(poses) > LEAST_VALIDITY]
        pressed = (roots(poses) > 0.0).any(axis=1)
        for half, most, rows in zip(halves, sizes, (pressed, ~pressed), strict=True):
            half.extend(poses[rows][: most - len(half)])
        if all(len(half) == most for half, most in zip(halves, sizes, strict=True)):
            break
    return label_poses(model, samples.scene, np.array([*halves[0], *halves[1]]).reshape(-1, 6), progress)


def uniform_count(samples: Samples) -> int:
    """Default count of `uniform_samples`: a third of the samples, at most 6,000 (2,000 of a user's own model, which
    may be slow)."""
    return min(len(samples) // 3, 2000 if model_name_of(samples) is None else 6000)


def uniform_poses(samples: Samples, count: int, rng: np.random.Generator) -> Array:
    """Poses (count, 6) uniform in the range of the samples that are not test rows; ValueError where all are."""
    known = samples.poses[samples.role != TEST]
    if not len(known):
        raise ValueError(f"{len(samples)} samples, all of them test rows, expected some that were learned: no range")
    return samples.scene.pose_space.onto(known.min(axis=0) + np.ptp(known, axis=0) * rng.random((count, 6)))


def label_poses(
    model: WrenchModel, scene: Scene, poses: Array, progress: Progress | None = None, *, rim: bool = False
) -> Samples:
    """Poses (n, 6) with the model's loads, without gaps; roles, dropped poses and progress as in `perturbed_samples`.
    rim: keep those whose contact runs off the elements."""
    count, width, at_once = len(poses), len(scene.parts), 1000
    role: Array = np.where(np.arange(count) % 2 == 0, VALIDATION, TEST).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    loads, kept = [np.zeros((0, width, 6))], np.ones(count, dtype=bool)
    for first in range(0, count, at_once):
        rows = slice(first, first + at_once)
        if not rim:
            kept[rows] = ~reaches_edge(model, poses[rows])
        loads.append(part_wrenches(model, poses[rows][kept[rows]], width))
        if progress is not None:
            progress(min(first + at_once, count), count)
    wrenches = np.concatenate(loads)
    finite = np.isfinite(wrenches).all(axis=(1, 2))
    kept[kept] = finite
    dropped = Dropped(poses[~kept], domain[~kept])
    gaps = np.full((int(finite.sum()), width), np.nan)
    return Samples(scene, poses[kept], wrenches[finite], gaps, domain[kept], role[kept], dropped=dropped)
