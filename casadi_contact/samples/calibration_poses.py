"""Poses besides the samples at which a surrogate is compared with its contact model.

Samples lie where loads were prescribed. Users evaluate a surrogate elsewhere: around equilibria, at any pose within the
range, and where the surrogate's own loads lead a solver (self-settled poses), such as beyond the rim of an insert.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from time import perf_counter

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.samples.chunk import wrenches_of
from casadi_contact.samples.draw import teacher_job
from casadi_contact.samples.models import model_name_of
from casadi_contact.samples.reference import Cycle, reference_poses
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.cycle import scene_cycles
from casadi_contact.scenes.walking import has_gait, reference_cycles

_MOVES = np.repeat([1.0, np.deg2rad(2.0)], 3)  # mm, rad
_BEYOND = 0.5  # of the sampled range, to either side
_MOST_DRAWN = 200  # poses for one that is kept: chance alone seldom presses


def perturbed_poses(samples: Samples, count: int, *, seed: int = 12) -> Array:
    """Poses (count, 6) of the samples moved by up to 1 mm and 2° in every parameter.

    Half of the moves are uniform, half normal with these deviations; each times a number drawn evenly from 0 to 1.
    """
    rng = np.random.default_rng(seed)
    poses = samples.poses[rng.integers(len(samples), size=count)]
    moves = np.where(rng.random((count, 1)) < 0.5, rng.uniform(-1.0, 1.0, (count, 6)), rng.standard_normal((count, 6)))
    return samples.scene.pose_space.project(poses + rng.random((count, 1)) * moves * _MOVES)


def poses_in_range(
    samples: Samples, count: int, near: Callable[[Array], np.ndarray], roots: Callable[[Array], Array]
) -> Array:
    """Poses (m, 6), m <= 3/2·count, drawn evenly over the range of samples that are not test rows, and beyond it.

    In every other pose about two parameters of six, chosen by chance, are drawn from a range that is wider by half of
    itself on either side: the surrogate extrapolates there. near: mask (n,) of poses (n, 6) to keep; roots: their
    root loads (n, P) on the surrogate. Two in three poses are in contact, up to 1.2 times the largest sampled roots.
    """
    known, rng = samples.poses[samples.role != TEST], np.random.default_rng(13)
    low, span = known.min(axis=0), np.ptp(known, axis=0)
    largest = 1.2 * np.maximum(roots(known).max(axis=0), 0.0)
    kept: tuple[list[Array], list[Array]] = [], []
    wanted, at_once = (count, count // 2), 20_000
    for _ in range(0, max(_MOST_DRAWN * count, 1), at_once):
        wider = _BEYOND * ((rng.random((at_once, 6)) < 1.0 / 3.0) & (rng.random((at_once, 1)) < 0.5))
        unit = rng.random((at_once, 6)) * (1.0 + 2.0 * wider) - wider
        poses = samples.scene.pose_space.project(low + span * unit)
        poses = poses[near(poses)]
        s = roots(poses)
        pressed, lifted = ((s > 0.0).any(axis=1) & (s <= largest).all(axis=1)), (s <= 0.0).all(axis=1)
        for part, most, rows in zip(kept, wanted, (pressed, lifted), strict=True):
            part.extend(poses[rows][: most - len(part)])
        if all(len(part) == most for part, most in zip(kept, wanted, strict=True)):
            break
    return np.array([*kept[0], *kept[1]]).reshape(-1, 6)


def self_settled_poses(surrogate: ContactModel, samples: Samples, count: int) -> Array:
    """Poses (m, 6), m <= count, at which the static solver, from even starts, balances training loads on the surrogate.

    Each patch (all together, where they share one sensitive pose parameter) has its normal load from another sample; in
    a quarter of the poses the loads are multiplied by u³ with u drawn evenly from 0 to 1, because every contact begins
    and ends lightly. There are none where the surrogate lacks one of these loads.
    """
    scene, rng = samples.scene, np.random.default_rng(17)
    training, known = samples.select(role=TRAIN), samples.poses[samples.role != TEST]
    target: dict[str, Array] = {}
    for load in scene.controllable_normal_loads:
        values = training.loads(load.loads)
        values = values[(values != 0.0).any(axis=1)]
        if len(values):
            target |= zip(load.loads, values[rng.integers(len(values), size=count)].T, strict=True)
    if len(target) != len(scene.sensitive_pose) or not target or not set(target) <= set(surrogate.load_names):
        return np.empty((0, 6))
    shares = np.where(rng.random(count) < 0.25, rng.random(count) ** 3, 1.0)
    starts = known.min(axis=0) + np.ptp(known, axis=0) * rng.random((count, 6))
    poses, report = settle(
        surrogate,
        scene.pose_space.project(starts),
        scene.sensitive_pose,
        {name: shares * load for name, load in target.items()},
        tolerance=1e-2,
        max_iterations=40,
        trust_region=False,
    )
    return poses[report.converged]


def cycle_poses(surrogate: ContactModel, samples: Samples, count: int = 3) -> Array:
    """Poses (n, 6) of `count` cycles of the scene's reference motion, drawn with another seed than the plan's. They are
    found on the surrogate from the middle of the samples. Empty for a scene without a motion, and where the surrogate
    lacks a load of it."""
    scene, known = samples.scene, samples.poses[samples.role != TEST]
    cycles: list[Cycle] = [*reference_cycles(count, seed=5)] if has_gait(scene) else []
    cycles += scene_cycles(scene, seed=5)[:count] if scene.motion else []
    free = [name for name in scene.pose_space.free_names if cycles and name not in cycles[0].pose]
    if not free or not set(cycles[0].targets()) <= set(surrogate.load_names):
        return np.empty((0, 6))
    start = scene.pose_space.project(np.median(known, axis=0)[None])[0]
    poses, report = reference_poses(surrogate, cycles, start=start, tolerance_n=0.1, every_cycle=False)
    return poses[report.converged]


def label_poses(
    model: ContactModel, samples: Samples, poses: Array, executor: Executor | None = None, *, slow_s: float = 1e-3
) -> Samples:
    """Poses (n, 6) with the loads of the samples' model, off its elements too; validation and test rows in turn.

    executor: workers, used where a pose of a model of the library takes more than slow_s. Loads are NaN where the model
    gives none, gaps everywhere: they take longer and are not needed.
    """
    count, width, begun = len(poses), len(samples.scene.patches), perf_counter()
    first, *rest = (poses[k : k + 100] for k in range(0, max(count, 1), 100))
    found = [wrenches_of(model, first, width)]
    slow = perf_counter() - begun > slow_s * len(first)
    if executor is not None and slow and model_name_of(samples) is not None:
        found.extend(executor.map(teacher_job(samples), rest))
    else:
        found.extend(wrenches_of(model, block, width) for block in rest)
    wrenches = np.concatenate(found)
    wrenches[~np.isfinite(wrenches).all(axis=(1, 2))] = np.nan
    role = np.where(np.arange(count) % 2 == 0, VALIDATION, TEST).astype(np.uint8)
    return Samples(samples.scene, poses, wrenches, np.full((count, width), np.nan), np.ones(count, np.uint8), role)
