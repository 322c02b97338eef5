"""Where a contact problem begins: the learned range of poses, sizes of its variables, and starts in contact.

From a start in contact an optimiser finds its way, from 20 mm off it may not.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from casadi_contact.contact.approach import advance_to_contact, touching_start
from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.conventions import LEVER_MM, POSE_NAMES, WRENCH_NAMES, Array, pose_index
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.scenes.scene import Scene

LEAST_START_N = 20.0  # of each patch, so that a start is in contact


def learned_range(model: SymbolicContact) -> tuple[Array, Array]:
    """Lowest and highest pose (6,), (6,) [mm, rad] that a surrogate has learned, infinite where it does not say."""
    ranges = model.record.get("pose_range", {})
    pairs = np.array([ranges.get(name, (-np.inf, np.inf)) for name in POSE_NAMES])
    return pairs[:, 0], pairs[:, 1]


def pose_bounds(model: SymbolicContact) -> tuple[Array, Array]:
    """Lowest and highest pose (6,), (6,) [mm, rad] that an optimiser may try: the learned range of a surrogate; of a
    model that knows its gaps, the scene's reach and half a turn about the first touch. Infinite of others."""
    if model.record.get("pose_range") or not model.has_gaps:
        return learned_range(model)
    touch, reach = touching_start(model), np.repeat([model.scene.reach_mm, np.pi], 3)
    return touch - reach, touch + reach


def middle_pose(model: SymbolicContact) -> Array:
    """The middle (6,) of the learned range; where there is none, `touching_start`, and likewise where the patches are
    pressed in no single direction: in a cup the middle touches nothing, and no direction leads from there to contact.
    """
    (low, high), space = learned_range(model), model.scene.pose_space
    known = np.isfinite(low) & np.isfinite(high)
    if known.any() and model.scene.normal_loads[0].direction is not None:
        pairs = zip(low, high, known, strict=True)
        return space.project(np.array([0.5 * (a + b) if both else 0.0 for a, b, both in pairs]))
    return touching_start(model)


def pose_steps(sensitive_pose: Sequence[str]) -> Array:
    """Moves (6,) [mm, rad] that change contact loads about alike, by some 30 N: a pose parameter that presses the
    bodies together (a scene's ``sensitive_pose``) is that much stiffer than one along which they slide or turn.

    Variables scaled by these are alike to IPOPT, whose regularisation then bears on all of them alike."""
    pressing = [0.01] * 3 + [0.01 / LEVER_MM] * 3
    sliding = [0.5, 0.5, 0.3, 0.02, 0.02, 0.02]
    return np.where([name in sensitive_pose for name in POSE_NAMES], pressing, sliding)


KNEE_STEPS = pose_steps(("ty", "rx"))


def settle_in_range(
    model: SymbolicContact,
    poses: Array,
    rest: Array,
    free: Sequence[str],
    pressing: Mapping[str, Array],
    tolerance_n: float = 1.0,
) -> Array:
    """Bring poses (n, 6) into their bounds and settle the sensitive pose parameters under target normal loads (n,) by
    name. Parameters that are not free take the values of rest (n, 6).

    A pose that ends out of bounds, or unsettled, begins again from rest, then from where the elements of a surrogate's
    scene settle (of a foundation: its first touch). Where that fails too, the pose is only brought into its bounds."""
    columns = [pose_index(name) for name in free]
    locked = [i for i in range(6) if i not in columns]
    low, high = pose_bounds(model)
    poses = poses.copy()
    poses[:, columns] = np.clip(poses[:, columns], low[columns], high[columns])
    poses[:, locked] = rest[:, locked]
    poses = model.scene.pose_space.project(poses)
    moved = model.scene.sensitive_pose
    if not pressing or not moved or not set(moved) <= set(free):
        return poses
    left = np.arange(len(poses))
    for begin in (poses.copy, lambda: rest, lambda: _in_contact(model, poses, rest, free, pressing)):
        forces = {name: target[left] for name, target in pressing.items()}
        tried, report = settle(model, begin()[left], moved, forces, tolerance=tolerance_n, max_iterations=30)
        good = report.converged & ((tried >= low) & (tried <= high))[:, columns].all(axis=1)
        poses[left[good]] = tried[good]
        surrogate: Any = model
        if getattr(model, "confidence", None) is not None:  # in false contact validity is small
            good &= surrogate.validity(tried) >= 0.5
        left = left[~good]
        if not len(left):
            break
    return poses


def _in_contact(
    model: SymbolicContact, poses: Array, rest: Array, free: Sequence[str], pressing: Mapping[str, Array]
) -> Array:
    """Poses (n, 6) settled on the elements of a surrogate's scene; of other models and scenes the first touch."""
    elements = reference_model(model.scene, "settle") if model.record.get("pose_range") else ""
    if isinstance(elements, str):
        return touching(model, rest, free, pressing)
    return settle_in_range(symbolic(elements), poses, rest, free, pressing)


def touching(model: SymbolicContact, poses: Array, free: Sequence[str], pressing: Mapping[str, Array]) -> Array:
    """Poses (n, 6) moved into contact by `advance_to_contact`. They stay as they are if the model has no gaps, if a
    translation that would move is not free, or if the scene has no loading direction and no target force gives one."""
    normal = model.scene.normal_loads[0]
    directed = normal.component is not None
    parts = normal.loads if normal.component is None else (normal.component,)
    moved = [f"t{name[1]}" for name in parts if directed or np.any(pressing.get(name, 1.0))]
    known = model.has_gaps and set(moved) <= set(free) and (directed or set(normal.loads) <= set(pressing))
    return advance_to_contact(model, poses, pressing) if known else poses


def press_together(model: SymbolicContact, poses: Array, rest: Array, loads: Array, free: Sequence[str]) -> Array:
    """`settle_in_range` under the normal loads that total loads (n, 6) put on the patches.

    A single patch, or patches that one pose parameter sets together, carry all. Each of two patches carries its share
    (`shares`), at least `LEAST_START_N`; at least half of a smaller total, and never below 10 N, so that it touches."""
    normals = model.scene.controllable_normal_loads
    if len(normals) == 1:
        columns = [WRENCH_NAMES.index(name.partition("_")[0]) for name in normals[0].loads]
        forces = normals[0].at_least(loads[:, columns], LEAST_START_N)
        return settle_in_range(model, poses, rest, free, dict(zip(normals[0].loads, forces.T, strict=True)))
    if len(normals) != 2 or any(normal.direction is None for normal in normals):
        return settle_in_range(model, poses, rest, free, {})
    first, second = shares(model.scene, loads)
    total = first + second
    least = np.minimum(LEAST_START_N, np.maximum(0.5 * total, 10.0))
    first = np.clip(first, least, np.maximum(total - least, least))
    sizes = (first, np.maximum(total - first, least))
    pressing = {n.loads[0]: n.with_size(loads, size)[:, 0] for n, size in zip(normals, sizes, strict=True)}
    return settle_in_range(model, poses, rest, free, pressing)


def shares(scene: Scene, loads: Array) -> tuple[Array, Array]:
    """Normal loads (n,), (n,) of two patches, pressed at their anchors a along d, that make up total loads (n, 6):
    F = N₁·d₁ + N₂·d₂, and where both are pressed along one line, T·w = (N₁·a₁×d₁ + N₂·a₂×d₂)·w with
    w = a₁×d₁ - a₂×d₂; of a knee the two vertical forces at the condyles' centres with the given Fy and Tx."""
    along = np.array([normal.direction for normal in scene.controllable_normal_loads])
    arms = np.cross(scene.anchors_mm, along)
    apart = arms[0] - arms[1]
    rows = np.column_stack([along[0], along[1]])
    given = loads[:, :3]
    if np.linalg.matrix_rank(rows) < 2:
        rows = np.vstack([rows, apart @ arms.T])
        given = np.column_stack([given, loads[:, 3:] @ apart])
    first, second = np.linalg.pinv(rows) @ given.T
    return first, second
