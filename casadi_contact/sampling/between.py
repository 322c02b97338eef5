"""Many poses between known samples and a little beyond, to find those on which a surrogate is worst.

A surrogate is most wrong where it bears falsely: in corners of the sampled range in which no sample tells it that
nothing touches. They are so small that the points of a plan seldom meet them. Poses here are settled under no load, and
of most of them the wrench alone is asked for: that takes a hundredth of the time of a sample of the plan.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import TypeVar

import numpy as np

from casadi_contact.conventions import Array, Progress, load_selection
from casadi_contact.dataset import TEST, Samples
from casadi_contact.dataset.errors import LoadModel
from casadi_contact.sampling.chunk import DrawnChunk, evaluate_poses, joined, reaches_edge
from casadi_contact.sampling.draw import settings_of
from casadi_contact.sampling.worker_models import ModelPair, WorkerModels, one_thread
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.workers import cancelled_if_left, worker_pool

BEYOND, ALONG = 0.1, 0.2  # of the way to another sample: at most away from it, into the corners, and towards it
_SPARE = 8  # times as many of the worst as are wanted: in most of the worst contact runs off the elements
_AT_ONCE, _FEW_AT_ONCE = 20_000, 500  # poses to ask for wrenches alone, and for more

Made = TypeVar("Made")


def poses_between(samples: Samples, count: int, seed: int) -> tuple[Array, np.ndarray]:
    """Poses (count, 6) and their domain (count,): p + u·(q - p) of learned samples p and q of one domain, drawn at
    random, u evenly from -`BEYOND` to `ALONG`; within the scene's pose space."""
    known, rng = samples.rows(samples.role != TEST), np.random.default_rng([seed, 19])
    rows, partners = rng.integers(len(known), size=count), np.empty(count, dtype=int)
    for number in np.unique(known.domain):
        of_domain, wanted = np.flatnonzero(known.domain == number), known.domain[rows] == number
        partners[wanted] = of_domain[rng.integers(len(of_domain), size=int(wanted.sum()))]
    begin, share = known.poses[rows], rng.uniform(-BEYOND, ALONG, (count, 1))
    return known.scene.pose_space.onto(begin + share * (known.poses[partners] - begin)), known.domain[rows]


def worst_between(
    model: LoadModel,
    samples: Samples,
    models: ModelPair,
    count: int,
    most: int,
    *,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Samples:
    """Training rows: of `count` `poses_between` the samples those, `most` at most, on which a model is worst.

    The error of a pose is max over loads |model - contact model|/tolerance, the scene's tolerances. No patch presses
    harder there than in any of the samples. models: makes those that the samples come from (`models_of`).
    progress(done, all): poses so far.
    """
    if not count or not most or (samples.role == TEST).all():
        return samples.rows(np.zeros(len(samples), dtype=bool))
    poses, domain = poses_between(samples, count, seed)
    asked = WorkerModels.of(samples.scene, settings_of(samples), models)
    with worker_pool(executor) as workers:
        errors = _errors(workers, asked, model, samples, poses, progress)
        order = np.argsort(-errors, kind="stable")[: _SPARE * most]
        order = order[errors[order] >= 0.0]
        edge = _in_parts(workers, _at_edge, asked, poses[order])
        chosen = order[~np.concatenate(edge)][:most]
        found = joined(samples.scene, _in_parts(workers, _whole, asked, poses[chosen], domain[chosen]))
    return found


def _in_parts(
    workers: Executor, function: Callable[..., Made], asked: WorkerModels, *columns: np.ndarray
) -> list[Made]:
    """What a function makes of columns (n, ...), a few rows at once."""
    parts = range(0, max(len(columns[0]), 1), _FEW_AT_ONCE)
    futures = [workers.submit(function, asked, *(c[k : k + _FEW_AT_ONCE] for c in columns)) for k in parts]
    with cancelled_if_left(workers, futures):
        return [future.result() for future in futures]


def _errors(
    workers: Executor,
    asked: WorkerModels,
    model: LoadModel,
    samples: Samples,
    poses: Array,
    progress: Progress | None,
) -> Array:
    """Errors (n,) of a model at poses (n, 6), in tolerances; -1 where contact presses harder than in any sample, or its
    model gives no number."""
    scene, names = samples.scene, model.load_names
    selection, tolerances = load_selection(names, scene.patch_names), scene.tolerances_of(names)
    pressed = np.add.reduceat(samples.wrenches, scene.first_parts, axis=1)
    hardest = normal_forces(scene.normal_loads, pressed).max(axis=0)
    errors = np.full(len(poses), -1.0)
    blocks = [slice(first, first + _AT_ONCE) for first in range(0, len(poses), _AT_ONCE)]
    futures: list[Future[Array]] = [workers.submit(_wrenches, asked, poses[rows]) for rows in blocks]
    with cancelled_if_left(workers, futures):
        for rows, future in zip(blocks, futures, strict=True):
            wrenches = future.result()
            known = np.asarray(np.isfinite(wrenches).all(axis=(1, 2)))
            known[known] = (normal_forces(scene.normal_loads, wrenches[known]) <= hardest).all(axis=1)
            wanted = np.einsum("lpk,npk->nl", selection, wrenches[known])
            off = np.max(np.abs(model(poses[rows][known]) - wanted) / tolerances, axis=1, initial=0.0)
            errors[rows.start + np.flatnonzero(known)] = off
            if progress is not None:
                progress(min(rows.stop, len(poses)), len(poses))
    return errors


def _wrenches(asked: WorkerModels, poses: Array) -> Array:
    """Wrenches of the patches (n, patches, 6); runs in a worker."""
    with one_thread():
        return asked.pair()[1].wrenches(poses)


def _at_edge(asked: WorkerModels, poses: Array) -> np.ndarray:
    """True (n,) where contact runs off the elements; runs in a worker."""
    with one_thread():
        return reaches_edge(asked.pair()[1], poses)


def _whole(asked: WorkerModels, poses: Array, domain: np.ndarray) -> DrawnChunk:
    """What becomes samples of these poses; runs in a worker."""
    settled_on, teacher = asked.pair()
    with one_thread():
        return evaluate_poses(teacher, settled_on.scene, poses, domain)
