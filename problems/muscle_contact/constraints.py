"""Constraints of a muscle problem: balance of femur and patella, co-contraction, what muscles cannot do at once.

Each is scaled to about what a scaled variable changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS, contact_expression, in_newtons
from casadi_contact.optimisation.muscle import MuscleParameters
from casadi_contact.optimisation.muscle_walk import MuscleWalk
from problems.muscle_contact.cocontraction import CALF_ARM_M, SOLEUS_N, ankle_moment, calf, closed_sides, heads
from problems.muscle_contact.dynamics import activation_rows, equilibrium_rows
from problems.muscle_contact.extensor import Extensor, quadriceps
from problems.muscle_contact.variables import Variables

HELD_N = 0.01  # on the patella for each move from where it began that a load of 30 N would make
_SCALE = 0.1  # of what is left of a balance, in newtons


class Frames(NamedTuple):
    """n frames of a walk as expressions of the variables v: forces along the tendons (m, n) [N] of its muscles, and
    pose, loads and root loads of the knee."""

    walk: MuscleWalk
    muscles: MuscleParameters
    v: Variables
    forces: ca.MX
    knee: ContactFrames


class Constraints:
    """Constraints low <= expression <= high, numbers or one for each entry, column by column."""

    def __init__(self) -> None:
        self.parts: list[tuple[ca.MX, Array, Array]] = []

    def add(self, expression: ca.MX, low: Any, high: Any) -> None:
        """Take up an expression (r, n), bounds numbers or (n, r)."""
        low, high = (np.broadcast_to(bound, expression.shape[::-1]).ravel() for bound in (low, high))
        self.parts.append((ca.vec(expression), low, high))

    def together(self) -> tuple[ca.MX, Array, Array]:
        """All of them as one column, with bounds."""
        expressions, lows, highs = zip(*self.parts, strict=True)
        return ca.vertcat(*expressions), np.concatenate(lows), np.concatenate(highs)


def balance_femur(
    constraints: Constraints, frames: Frames, balanced: Sequence[str], reserves: ca.MX, by_patella: ca.MX | None
) -> None:
    """Σ_m arm_m·F_m + contact + reserves = inverse dynamics, for each balanced coordinate.

    reserves (b, n) [N, N·m]. by_patella (6, n) [N, N·m], in the order of `COORDINATES`: what takes the place of the
    quadriceps' arms, None where they pull along them.
    """
    walk, direct = frames.walk, np.ones(len(frames.muscles.names))
    if by_patella is not None:
        direct[quadriceps(frames.muscles.names)] = 0.0
    others = _contact_function(balanced).map(len(walk))(frames.knee.pose, frames.knee.loads) + reserves
    for row, name in enumerate(balanced):
        pull = ca.sum1(ca.DM((direct * walk.arms[name]).T) * frames.forces)
        if by_patella is not None:
            pull += by_patella[list(COORDINATES).index(name), :]
        left = pull + others[row, :] - ca.DM(walk.loads[name]).T
        constraints.add(_SCALE * in_newtons(name) * left, 0.0, 0.0)


def _contact_function(balanced: Sequence[str]) -> ca.Function:
    """(pose (6), contact loads (7)) of one frame -> contact loads of balanced coordinates [N, N·m]."""
    pose, loads = ca.MX.sym("pose", 6), ca.MX.sym("loads", len(KNEE_LOADS))
    contact = contact_expression(pose, loads)
    return ca.Function("contact", [pose, loads], [ca.vertcat(*(contact[name] for name in balanced))])


def balance_patella(
    constraints: Constraints, frames: Frames, extensor: Extensor, resting: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Equilibrium of the patella between quadriceps, tendon and groove.

    Returns what all of it does to the femur (6, n) [N, N·m] in the order of `COORDINATES`, and the patella's pose (6,
    n) in the tibia. resting (6, n): its variables where it begins, which hold it lightly where nothing presses it.
    """
    tension = ca.sum1(frames.forces[quadriceps(frames.muscles.names), :])
    on_femur, left, pose = extensor.balance(frames.knee.pose, frames.v.patella, tension)
    constraints.add(_SCALE * (left - HELD_N * (frames.v.patella - resting)), 0.0, 0.0)
    return on_femur, pose


def cocontract(
    constraints: Constraints, frames: Frames, *, margin_mm: float, share_heads: bool, ankle: bool, shank_m: float
) -> None:
    """The rules of `cocontraction`: both sides closed, and by choice shared heads and the ankle's moment."""
    walk, names, v = frames.walk, frames.muscles.names, frames.v
    constraints.add(frames.knee.roots, closed_sides(frames.knee.model, walk.loads["knee_ty"], margin_mm), np.inf)
    if share_heads:
        first, other = np.array(heads(names)).T
        constraints.add(v.activations[first.tolist(), :] - v.activations[other.tolist(), :], 0.0, 0.0)
    if ankle:
        pull = ca.sum1(frames.forces[calf(names), :]) + SOLEUS_N * v.soleus
        beyond = CALF_ARM_M * pull - ca.DM(ankle_moment(walk, shank_m)).T
        constraints.add(_SCALE * in_newtons("knee_flexion") * beyond, 0.0, np.inf)


def follow_muscles(
    constraints: Constraints, frames: Frames, *, activation_dynamics: bool, compliant_tendons: bool
) -> None:
    """What couples frames (`dynamics`), by choice: activations that lag, tendons in equilibrium with their fibres."""
    walk, v = frames.walk, frames.v
    if activation_dynamics:
        constraints.add(activation_rows(ca.vertcat(v.activations, v.soleus), walk.time_s), 0.0, np.inf)
    if compliant_tendons:
        moved = equilibrium_rows(frames.muscles, walk.lengths_m, walk.time_s, v.activations, v.tensions)
        constraints.add(10.0 * moved, 0.0, 0.0)
