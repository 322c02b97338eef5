"""Starts in contact: from there an optimiser finds its way, from 20 mm off it may not."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import POSE_NAMES, WRENCH_NAMES, Array, as_poses, pose_index
from casadi_contact.optimisation.pose_range import middle_pose, pose_bounds
from casadi_contact.quantities import two_digits
from casadi_contact.scenes import Scene
from casadi_contact.statics import first_touch, settle
from casadi_contact.statics.leaps import leaps

SHEAR_FREE_LOAD_N = 500.0
LEAST_START_N = 20.0  # of each patch, so that a start is in contact
_FOLLOWED = 5  # frames that poses without shear are followed from, in turn
_MOST_SHEAR_N = 0.1 * SHEAR_FREE_LOAD_N  # where there is no place without
_SETTLED_N = 1.0  # how near a start comes to the wanted normal loads
_LEAST_SHARE_N = 10.0 * _SETTLED_N  # of a patch under a light load: out of contact is never that near


def start_or_default(start: ArrayLike | None, default: Array) -> Array:
    """A copy of a start (n, 6), of the default (n, 6) if there is none; ValueError for another number of poses."""
    if start is None:
        return default.copy()
    poses = as_poses(start).copy()
    if len(poses) != len(default):
        raise ValueError(f"start has {len(poses)} poses, expected one for each of {len(default)} frames")
    return poses


def settle_in_range(
    model: SymbolicContact, poses: Array, rest: Array, free: Sequence[str], pressing: Mapping[str, Array]
) -> Array:
    """Poses (n, 6) brought into the learned range, locked parameters as at rest (n, 6) and as the scene says, the
    sensitive ones settled under wanted normal loads (n,) by name, as far as they are free.

    Settling compares root loads, which keep their slope out of contact; where it leads out of the learned range, it
    begins again at rest, then at the first touch of a model that knows its gaps, and where that fails too, the pose is
    only brought into the range.
    """
    columns = [pose_index(name) for name in free]
    locked = [i for i in range(6) if i not in columns]
    low, high = pose_bounds(model)
    poses = poses.copy()
    poses[:, columns] = np.clip(poses[:, columns], low[columns], high[columns])
    poses[:, locked] = rest[:, locked]
    poses = model.scene.pose_space.onto(poses)
    moved = model.scene.sensitive_pose
    if not pressing or not moved or not set(moved) <= set(free):
        return poses
    left = np.arange(len(poses))
    for begin in _begins(model, poses, rest, free, pressing):
        forces = {name: wanted[left] for name, wanted in pressing.items()}
        tried, report = settle(model, begin[left], moved, forces, tolerance=_SETTLED_N, max_iterations=30)
        good = report.converged & ((tried >= low) & (tried <= high))[:, columns].all(axis=1)
        poses[left[good]] = tried[good]
        left = left[~good]
        if not len(left):
            break
    return poses


def _begins(
    model: SymbolicContact, poses: Array, rest: Array, free: Sequence[str], pressing: Mapping[str, Array]
) -> Iterator[Array]:
    """Where settling begins, in turn, each (n, 6)."""
    yield poses.copy()
    yield rest
    yield touching(model, rest, free, pressing)


def touching(model: SymbolicContact, poses: Array, free: Sequence[str], pressing: Mapping[str, Array]) -> Array:
    """Poses (n, 6) moved to the first touch (`first_touch`); as they are where the model knows no gaps, what moves is
    not free, or a scene is pressed in no direction and the wanted force (n,) is not given by its names. Along a part of
    the force that is zero throughout nothing moves."""
    normal = model.scene.normal_loads[0]
    directed = normal.component is not None
    parts = normal.loads if normal.component is None else (normal.component,)
    moved = [f"t{name[1]}" for name in parts if directed or np.any(pressing.get(name, 1.0))]
    known = hasattr(model, "gaps") and set(moved) <= set(free) and (directed or set(normal.loads) <= set(pressing))
    return first_touch(model, poses, pressing) if known else poses


def press_together(model: SymbolicContact, poses: Array, rest: Array, loads: Array, free: Sequence[str]) -> Array:
    """`settle_in_range` under what presses the patches, as the total loads (n, 6) tell it.

    What is pressed in one (a single patch, or all patches that one pose parameter sets together) bears its forces
    among them; each of two patches its share (`shares`), `LEAST_START_N` at least, or half of a load below twice that.
    """
    normals = model.scene.pressed
    if len(normals) == 1:
        columns = [WRENCH_NAMES.index(name.partition("_")[0]) for name in normals[0].loads]
        forces = normals[0].at_least(loads[:, columns], LEAST_START_N)
        return settle_in_range(model, poses, rest, free, dict(zip(normals[0].loads, forces.T, strict=True)))
    if len(normals) != 2 or any(normal.direction is None for normal in normals):
        return settle_in_range(model, poses, rest, free, {})
    first, second = shares(model.scene, loads)
    total = first + second
    least = np.minimum(LEAST_START_N, np.maximum(0.5 * total, _LEAST_SHARE_N))
    first = np.clip(first, least, np.maximum(total - least, least))
    sizes = (first, np.maximum(total - first, least))
    pressing = {n.loads[0]: n.with_size(loads, size)[:, 0] for n, size in zip(normals, sizes, strict=True)}
    return settle_in_range(model, poses, rest, free, pressing)


def shares(scene: Scene, loads: Array) -> tuple[Array, Array]:
    """Normal loads (n,), (n,) of two patches, pressed at their anchors a along d, that make up total loads (n, 6):
    F = N₁·d₁ + N₂·d₂, and where both are pressed along one line, T·w = (N₁·a₁×d₁ + N₂·a₂×d₂)·w with
    w = a₁×d₁ - a₂×d₂; of a knee the two vertical forces at the condyles' centres with the wanted Fy and Tx."""
    along = np.array([normal.direction for normal in scene.pressed])
    arms = np.cross(scene.anchors_mm, along)
    apart = arms[0] - arms[1]
    rows = np.column_stack([along[0], along[1]])
    wanted = loads[:, :3]
    if np.linalg.matrix_rank(rows) < 2:
        rows = np.vstack([rows, apart @ arms.T])
        wanted = np.column_stack([wanted, loads[:, 3:] @ apart])
    first, second = np.linalg.pinv(rows) @ wanted.T
    return first, second


def shear_free_poses(model: SymbolicContact, ry: Array, rz: Array) -> Array:
    """Poses (n, 6) at given rotations (n,), (n,) [rad] where equal vertical forces on both sides of a knee cause no
    shear, Fx = Fz = 0: what fixes the pose parameters that nothing else does. On a convex tibia there are several, and
    frames that find none from the middle, or another than their neighbours (`leaps`), follow these. Where there is none
    the femur stands where shear is least, and a RuntimeWarning names the frames.

    Raises ValueError where rotations lie outside what the surrogate learned, the least shear found is more than a tenth
    of the force on a side, or the scene locks or ties pose parameters.
    """
    model.scene.pose_space.check_whole("a pose without shear")
    low, high = pose_bounds(model)
    poses = np.tile(middle_pose(model), (len(rz), 1))
    for name, wanted in (("ry", ry), ("rz", rz)):
        column = POSE_NAMES.index(name)
        poses[:, column] = wanted
        if wanted.min() < low[column] or wanted.max() > high[column]:
            raise ValueError(
                f"{name} reaches from {wanted.min():.3g} to {wanted.max():.3g} rad, the surrogate learned "
                f"{low[column]:.3g} to {high[column]:.3g}: train one around your own cycles"
            )
    alone, without = _without_shear(model, poses)
    best, shear = alone, without
    firsts = np.flatnonzero(without == 0.0)
    for first in firsts[:: max(1, len(firsts) // _FOLLOWED)].tolist():
        if _faults(best, shear) == (0, 0, 0):
            break
        tried = _followed(model, poses, alone[first], first)
        if _faults(*tried) < _faults(best, shear):
            best, shear = tried
    _tell_shear(shear)
    return best


def _faults(poses: Array, shear: Array) -> tuple[int, int, int]:
    """How many of poses (n, 6) are lost, how many bear shear (n,) [N], and how often what is not prescribed leaps."""
    return int(np.isinf(shear).sum()), int((shear > 0.0).sum()), int(leaps(poses)[:, :4].sum())


def _tell_shear(shear: Array) -> None:
    """ValueError where a shear (n,) [N] is infinite, a RuntimeWarning where it is not zero."""

    def nowhere(rows: np.ndarray) -> str:
        which = f"{int(rows.sum())} of {len(rows)} frames, first in frame {int(rows.argmax())}"
        return f"no place of the femur without shear under {SHEAR_FREE_LOAD_N:g} N on each side is found in {which}"

    if np.isinf(shear).any():
        raise ValueError(
            f"{nowhere(np.isinf(shear))}, nor one with {_MOST_SHEAR_N:g} N at most: are flexion and rotation those of "
            "this knee?"
        )
    if shear.any():
        said = f"{nowhere(shear > 0.0)}, as on a convex tibia: there the femur stands where shear is least"
        warnings.warn(f"{said} ({two_digits(shear.max())} N at most)", RuntimeWarning, stacklevel=3)


def _without_shear(model: SymbolicContact, poses: Array) -> tuple[Array, Array]:
    """Poses (n, 6) settled under equal forces on both sides without shear, and the shear left (n,) [N]: 0 where it is
    settled, infinite where the sides do not bear their forces or more than `_MOST_SHEAR_N` is left."""
    sides = dict.fromkeys(model.scene.sensitive_loads, -SHEAR_FREE_LOAD_N)
    poses, _ = settle(model, poses, ("ty", "rx"), sides, tolerance=1.0)
    targets = {**sides, "Fx": 0.0, "Fz": 0.0}
    poses, report = settle(model, poses, ("tx", "ty", "tz", "rx"), targets, tolerance=0.1)
    loads = dict(zip(model.load_names, model(poses).T, strict=True))
    shear = np.hypot(loads["Fx"], loads["Fz"])
    borne = np.all([np.abs(loads[name] - force) < _MOST_SHEAR_N for name, force in sides.items()], axis=0)
    left = np.where(borne & (shear <= _MOST_SHEAR_N), shear, np.inf)
    return poses, np.where(report.converged, 0.0, left)


def _followed(model: SymbolicContact, poses: Array, pose: Array, first: int) -> tuple[Array, Array]:
    """`_without_shear` of poses (n, 6), each begun at its neighbour's, outwards from the one (6,) of the first frame;
    it ends at a frame that is lost."""
    poses, shear = poses.copy(), np.full(len(poses), np.inf)  # lost, where it does not come
    poses[first], shear[first] = pose, 0.0
    for frames, step in ((range(first + 1, len(poses)), -1), (range(first - 1, -1, -1), 1)):
        for frame in frames:
            poses[frame, :4] = poses[frame + step, :4]
            poses[[frame]], shear[[frame]] = _without_shear(model, poses[[frame]])
            if np.isinf(shear[frame]):
                return poses, shear
    return poses, shear
