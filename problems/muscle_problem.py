"""The problem of `problems.muscle_contact`: its variables, its balance of every frame, its bounds and its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.structures import Surrogate
from problems.knee_coordinates import CONTACT_LOADS, COORDINATES, contact_expression, in_newtons
from problems.muscle import ForceCapacity, force_capacity
from problems.muscle_walk import MuscleWalk
from problems.neutral_pose import neutral_poses

BALANCED = ("knee_ty", "knee_adduction", "knee_flexion")
FREE = ("ty", "rx")
# What stands in for ligaments and for errors of inverse dynamics, N and N·m at the cost of one full activation. The
# contact alone balances ty and adduction, and muscles flexion: reserves there only keep an overloaded frame solvable.
RESERVE_SIZES = {
    "knee_tx": 100.0,
    "knee_ty": 10.0,
    "knee_tz": 100.0,
    "knee_adduction": 1.0,
    "knee_rotation": 10.0,
    "knee_flexion": 1.0,
}
_MOVES = {"tx": 0.5, "ty": 0.01, "tz": 0.3, "rx": 0.01 / 25.0}  # [mm, rad] like in effect


@dataclass(frozen=True)
class MuscleContact:
    """A problem that can be looked at unsolved: CasADi's nlp, bounds and start, and what it came from.

    Variables of a frame, in this order and scaled: activations, free pose parameters, reserves of balanced coordinates.
    """

    surrogate: Surrogate
    walk: MuscleWalk
    balanced: tuple[str, ...]
    free: tuple[str, ...]
    capacity: ForceCapacity
    neutral_poses: Array
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    lower_g: Array
    upper_g: Array
    start: Array

    @property
    def scales(self) -> Array:
        """Size of one unit of each variable of a frame: activation, mm or rad, N or N·m."""
        moves, reserves = [_MOVES[name] for name in self.free], [RESERVE_SIZES[name] for name in self.balanced]
        return np.array([1.0] * len(self.walk.muscles.names) + moves + reserves)


def _frame_function(surrogate: Surrogate, balanced: Sequence[str], free: Sequence[str]) -> ca.Function:
    """(scaled q (free), pose (6) of what is not free) -> contact loads of balanced coordinates [N, N·m], roots (2)."""
    q, given = ca.MX.sym("q", len(free)), ca.MX.sym("given", 6)
    pose = ca.vertcat(
        *(q[free.index(name)] * _MOVES[name] if name in free else given[k] for k, name in enumerate(POSE_NAMES))
    )
    loads, roots = surrogate.load_and_root_function(CONTACT_LOADS)(pose)
    contact = contact_expression(pose, loads)
    return ca.Function("contact_of_frame", [q, given], [ca.vertcat(*(contact[name] for name in balanced)), roots])


def build(
    surrogate: Surrogate,
    walk: MuscleWalk,
    *,
    model: str = "hill",
    fit_lengths: bool = True,
    balanced: Sequence[str] = BALANCED,
    free: Sequence[str] = FREE,
    exponent: float = 2.0,
    least_activation: float = 0.01,
) -> MuscleContact:
    """Pose the problem for all frames of a walk.

    model: "hill" or "isometric" (`problems.muscle`); fit_lengths scales generic fibre and tendon lengths to the
    person (`MuscleParameters.fitted_to`), by lengths only. balanced: coordinates of `COORDINATES`; free: ty, rx, and
    by choice tx and tz. exponent p >= 2 of the cost.

    Raises ValueError for unknown names, coordinates that the walk lacks, or settings out of range.
    """
    balanced, free = tuple(balanced), tuple(free)
    _check(walk, balanced, free, exponent, least_activation)
    muscles = walk.muscles.fitted_to(walk.lengths_m) if fit_lengths else walk.muscles
    capacity = force_capacity(muscles, walk.lengths_m, walk.velocities_m_per_s, model)
    poses = neutral_poses(surrogate, walk)
    frames, count, size = len(walk), len(muscles.names), len(balanced)

    variables = ca.MX.sym("variables", count + len(free) + size, frames)
    a, q, reserves = ca.vertsplit(variables, [0, count, count + len(free), variables.shape[0]])
    contact, roots = _frame_function(surrogate, balanced, free).map(frames)(q, ca.DM(poses.T))
    rows = []
    for row, name in enumerate(balanced):
        arms = walk.arms[name]
        muscle_load = ca.sum1(ca.DM((arms * capacity.active_n).T) * a).T
        rest = walk.loads[name] - (arms * capacity.passive_n).sum(axis=1)
        load = muscle_load + contact[row, :].T + RESERVE_SIZES[name] * reserves[row, :].T - ca.DM(rest)
        rows.append(0.1 * in_newtons(name) * load.T)  # about as large as what a scaled variable changes
    g = ca.vertcat(*rows, roots)
    objective = ca.sum1(ca.sum2(a**exponent)) + ca.sumsqr(reserves)
    nlp = {"x": ca.vec(variables), "f": objective, "g": ca.vec(g)}

    ranges = surrogate.record.get("pose_range", {})
    low = [ranges.get(name, (-np.inf, np.inf))[0] / _MOVES[name] for name in free]
    high = [ranges.get(name, (-np.inf, np.inf))[1] / _MOVES[name] for name in free]
    patches = len(surrogate.patch_names)
    start = np.zeros((frames, count + len(free) + size))
    start[:, :count] = max(0.05, least_activation)
    start[:, count : count + len(free)] = [
        [pose[POSE_NAMES.index(name)] / _MOVES[name] for name in free] for pose in poses
    ]
    return MuscleContact(
        surrogate,
        walk,
        balanced,
        free,
        capacity,
        poses,
        nlp,
        lower=np.tile([least_activation] * count + low + [-np.inf] * size, frames),
        upper=np.tile([1.0] * count + high + [np.inf] * size, frames),
        lower_g=np.zeros(frames * (size + patches)),
        upper_g=np.tile([0.0] * size + [np.inf] * patches, frames),
        start=start.ravel(),
    )


def _check(
    walk: MuscleWalk, balanced: tuple[str, ...], free: tuple[str, ...], exponent: float, least_activation: float
) -> None:
    for name in balanced:
        if name not in walk.loads:
            raise ValueError(f"walk {walk.name} has no loads and arms of {name!r}; it has {', '.join(walk.loads)}")
    if not balanced or len(set(balanced)) != len(balanced):
        raise ValueError(f"balanced is {balanced}, expected coordinates, each named once")
    if not set(FREE) <= set(free) <= set(_MOVES) or len(set(free)) != len(free):
        raise ValueError(f"free is {free}, expected ty and rx, and by choice tx and tz, each named once")
    needed = {COORDINATES[name] for name in balanced}
    if not set(free) <= needed:
        raise ValueError(f"{', '.join(set(free) - needed)} is free, but nothing balanced moves along it")
    if not exponent >= 2.0 or not 0.0 <= least_activation < 1.0:
        raise ValueError(
            f"exponent is {exponent} and least activation {least_activation}, expected >= 2 and from 0 to below 1"
        )
