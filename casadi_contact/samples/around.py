"""Poses around known ones, moved out of equilibrium: where an optimiser's steps and a user's own poses lie."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array, Progress
from casadi_contact.samples.chunk import WrenchModel, part_wrenches, reaches_edge
from casadi_contact.samples.samples import TEST, VALIDATION, Dropped, Samples
from casadi_contact.scenes.scene import Scene

AROUND_MM, AROUND_RAD = 1.0, float(np.deg2rad(2.0))
AROUND_COUNTS = (4000, 40_000)  # at least, at most; in between a third as many as the samples
_AT_ONCE = 1000  # poses


def samples_around(
    samples: Samples,
    model: WrenchModel,
    *,
    count: int | None = None,
    progress: Progress | None = None,
) -> Samples:
    """Poses of D1 moved by up to 1 mm and 2° in every parameter, and the model's loads there; count by the samples'.

    Half of the moves are uniform, half normal with these deviations, and a quarter of all are shortened at random;
    rows are validation and test in turn. Poses whose contact runs off the elements, and those where the model gives no
    number, are among the dropped ones. progress(done, all) is called as the model is evaluated.
    """
    rng = np.random.default_rng(12)
    if count is None:
        count = int(np.clip(len(samples) // 3, *AROUND_COUNTS))
    known = samples.select("D1").poses
    if not len(known):
        known = samples.poses
    if not len(known):
        raise ValueError("samples hold no row, expected some thousands: draw them first")
    poses = known[rng.integers(len(known), size=count)]
    moves = np.where(rng.random((count, 1)) < 0.5, rng.uniform(-1.0, 1.0, (count, 6)), rng.standard_normal((count, 6)))
    shortened = np.where(rng.random((count, 1)) < 0.25, rng.random((count, 1)), 1.0)
    poses = samples.scene.pose_space.onto(poses + shortened * moves * np.repeat([AROUND_MM, AROUND_RAD], 3))
    return samples_at(model, samples.scene, poses, progress)


def samples_at(
    model: WrenchModel, scene: Scene, poses: Array, progress: Progress | None = None, *, rim: bool = False
) -> Samples:
    """Poses (n, 6) with the model's loads and no gaps, which take longer and tell nothing of a surrogate's errors;
    roles, dropped poses and progress as in `samples_around`. rim: those whose contact runs off the elements belong to
    the samples as well."""
    count, width = len(poses), len(scene.parts)
    role: Array = np.where(np.arange(count) % 2 == 0, VALIDATION, TEST).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    loads, kept = [np.zeros((0, width, 6))], np.ones(count, dtype=bool)  # of no poses
    for first in range(0, count, _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        if not rim:
            kept[rows] = ~reaches_edge(model, poses[rows])
        loads.append(part_wrenches(model, poses[rows][kept[rows]], width))
        if progress is not None:
            progress(min(first + _AT_ONCE, count), count)
    wrenches = np.concatenate(loads)
    finite = np.isfinite(wrenches).all(axis=(1, 2))
    kept[kept] = finite
    lost = Dropped(poses[~kept], domain[~kept])
    gaps = np.full((int(finite.sum()), width), np.nan)
    return Samples(scene, poses[kept], wrenches[finite], gaps, domain[kept], role[kept], dropped=lost)
