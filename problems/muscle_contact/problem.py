"""Muscle and contact forces of a knee together, over a whole walking cycle, from inverse dynamics.

Muscles pull the femur onto the tibia, contact pushes back, and both balance the knee's inverse-dynamics loads. For all
frames at once, activations a (13), free pose parameters q (ty and rx; tx and tz by choice) and reserve loads r:

    min Σ a^p + Σ (r/size)²        p = 3: endurance (Crowninshield and Brand, J Biomech 14 (1981) 793-801)

    Σ_m arm_m·F_m(a_m) + contact(q) + r = inverse dynamics        for each balanced coordinate
    s_med(q), s_lat(q) >= √(least/N0),   least activation <= a <= 1,   q in the learned range

Heads of one muscle share an activation, both sides stay closed, and the calf works for the ankle too, with soleus as
one more activation (`cocontraction`); each by choice. By choice activations lag and tendons are compliant
(`dynamics`), which couples frames; else F is linear in a (`force_capacity`). contact(q) is the contact model's load on
the femur, as a generalised load: F of translations, Eᵀ(T - t×F) of rotations, about the moving origin
(`angular_velocity_map`). s is the signed root load: a side that need not carry anything at least touches, because
nothing else says where it floats. tx and tz where they are not free stand where equal forces on both sides cause no
shear. ry and rz are prescribed. Measured contact forces enter nowhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import POSE_NAMES, Array
from casadi_contact.optimisation import ContactFrames, shear_free_poses
from problems.common.knee_scene import KNEE_LOADS, check_knee
from problems.muscle_contact.cocontraction import CALF_ARM_M, SHANK_M, SOLEUS_N, ankle_moment, calf, closed_sides, heads
from problems.muscle_contact.dynamics import activation_rows, equilibrium_rows, tension_bounds
from problems.muscle_contact.extensor import Extensor, quadriceps
from problems.muscle_contact.knee_coordinates import COORDINATES, contact_expression, in_newtons
from problems.muscle_contact.muscle import ForceCapacity, MuscleParameters, force_capacity
from problems.muscle_contact.walk import MuscleWalk

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
HELD_N = 0.01  # on the patella for each move from where it began that a load of 30 N would make
MARGIN_MM = 20.0  # two standard deviations of where the load passes the knee from step to step (see docs)
LEAST_SQUARES: dict[str, Any] = {"exponent": 2.0, "margin_mm": 0.0, "share_heads": False, "ankle": False}
MAY_MOVE = ("tx", "ty", "tz", "rx")  # ry and rz are prescribed


@dataclass(frozen=True)
class MuscleContact:
    """A problem that can be looked at unsolved: CasADi's nlp, bounds and start, and what it came from.

    Variables of a frame, in this order and scaled: activations, free pose parameters, reserves of balanced coordinates,
    where the ankle counts soleus' activation, which is not held below 1 (what is beyond stands in like a reserve),
    where tendons are compliant their tensions over F0, and the patella's pose where the extensor mechanism counts.
    solution: those variables -> activations (m, n), poses (6, n), forces along the tendons (m, n) [N], reserves
    [N, N·m], soleus' activation and poses of the patella, for which the nlp's parameter is where they begin.
    first: the problem whose solution the one with a patella begins from.
    """

    contact_model: SymbolicContact
    walk: MuscleWalk
    balanced: tuple[str, ...]
    free: tuple[str, ...]
    muscles: MuscleParameters
    capacity: ForceCapacity
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    lower_g: Array
    upper_g: Array
    start: Array
    solution: ca.Function
    extensor: Extensor | None = None
    first: MuscleContact | None = None


class _Variables(NamedTuple):
    """Variables of n frames, as `MuscleContact` says: together (k, n), the rows of each kind, and by kind."""

    together: ca.MX
    rows: list[slice]
    activations: ca.MX
    pose: ca.MX
    reserves: ca.MX
    soleus: ca.MX
    tensions: ca.MX
    patella: ca.MX

    @classmethod
    def of(cls, frames: int, sizes: Sequence[int]) -> _Variables:
        """sizes: how many of each kind a frame has."""
        ends = [0, *itertools.accumulate(sizes)]
        together = ca.MX.sym("variables", ends[-1], frames)
        kinds = [slice(*pair) for pair in itertools.pairwise(ends)]
        return cls(together, kinds, *ca.vertsplit(together, ends))


class _Rows:
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


def _contact_function(balanced: Sequence[str]) -> ca.Function:
    """(pose (6), contact loads (7)) of one frame -> contact loads of balanced coordinates [N, N·m]."""
    pose, loads = ca.MX.sym("pose", 6), ca.MX.sym("loads", len(KNEE_LOADS))
    contact = contact_expression(pose, loads)
    return ca.Function("contact", [pose, loads], [ca.vertcat(*(contact[name] for name in balanced))])


def build(
    contact_model: SymbolicContact,
    walk: MuscleWalk,
    *,
    model: str = "hill",
    fit_lengths: bool = True,
    other_lengths_m: Array | None = None,
    balanced: Sequence[str] = BALANCED,
    free: Sequence[str] = FREE,
    exponent: float = 3.0,
    least_activation: float = 0.01,
    margin_mm: float = MARGIN_MM,
    share_heads: bool = True,
    by_volume: bool = False,
    ankle: bool = True,
    shank_m: float = SHANK_M,
    activation_dynamics: bool = False,
    compliant_tendons: bool = False,
    extensor: Extensor | None = None,
) -> MuscleContact:
    """Pose the problem for all frames of a walk.

    model: "hill" or "isometric" (`force_capacity`); fit_lengths scales generic fibre and tendon lengths to the
    person (`MuscleParameters.fitted_to`), by lengths only: those of this walk and, if given, of the person's other
    cycles (k, m) (`read_length_range`). balanced: coordinates of `COORDINATES`; free: ty, rx, and by choice tx and tz.
    exponent p >= 2 of the cost; by_volume weighs each muscle by F0·L0 over the mean. margin_mm, share_heads, ankle and
    shank_m: see `cocontraction`; ``LEAST_SQUARES`` leaves all of it out. activation_dynamics, compliant_tendons: see
    `dynamics`; tendons are compliant with model "hill" alone. extensor: the quadriceps pull through its patella,
    instead of along the walk's arms; see `build_with_patella`.

    Raises ValueError for unknown names, coordinates that the walk lacks, settings out of range, or a contact model of
    no knee with two sides (`check_knee`).
    """
    check_knee("a muscle problem", contact_model.scene, contact_model.load_names)
    balanced, free = tuple(balanced), tuple(free)
    _check(walk, balanced, free, exponent, least_activation)
    if compliant_tendons and model != "hill":
        raise ValueError(f"muscle model is {model}, expected hill where tendons are compliant")
    lengths = walk.lengths_m if other_lengths_m is None else np.vstack([walk.lengths_m, other_lengths_m])
    muscles = walk.muscles.fitted_to(lengths) if fit_lengths else walk.muscles
    capacity = force_capacity(muscles, walk.lengths_m, walk.velocities_m_per_s, model)
    try:
        poses = shear_free_poses(contact_model, walk.ry, walk.rz)
    except ValueError as error:
        raise ValueError(f"walk {walk.name}: {error}") from None
    count, patellar = len(muscles.names), 0 if extensor is None else len(POSE_NAMES)
    sizes = (count, len(free), len(balanced), int(ankle), count * int(compliant_tendons), patellar)
    v = _Variables.of(len(walk), sizes)
    forces = _forces(v, muscles, capacity)
    locked = {name: poses[:, k] for k, name in enumerate(POSE_NAMES) if name not in free}
    knee = ContactFrames(contact_model, len(walk), locked=locked, loads=KNEE_LOADS, variable=lambda *_: v.pose)
    stand_ins = ca.mtimes(ca.diag(ca.DM([RESERVE_SIZES[name] for name in balanced])), v.reserves)
    resting = ca.MX.sym("resting", patellar, len(walk))

    rows, patella = _Rows(), v.patella
    by_patella, direct = ca.MX.zeros(len(COORDINATES), len(walk)), np.ones(count)
    if extensor is not None:
        through = quadriceps(muscles.names)
        direct[through] = 0.0
        by_patella, left, patella = extensor.balance(knee.pose, v.patella, ca.sum1(forces[through, :]))
        held = HELD_N * (v.patella - resting)  # where nothing presses it, it may turn freely
        rows.add(0.1 * (left - held), 0.0, 0.0)
    others = _contact_function(balanced).map(len(walk))(knee.pose, knee.loads) + stand_ins
    for row, name in enumerate(balanced):
        pull = ca.sum1(ca.DM((direct * walk.arms[name]).T) * forces) + by_patella[list(COORDINATES).index(name), :]
        left = pull + others[row, :] - ca.DM(walk.loads[name]).T
        rows.add(0.1 * in_newtons(name) * left, 0.0, 0.0)  # about as large as what a scaled variable changes
    rows.add(knee.roots, closed_sides(contact_model, walk.loads["knee_ty"], margin_mm), np.inf)
    if share_heads:
        first, other = np.array(heads(muscles.names)).T
        rows.add(v.activations[first.tolist(), :] - v.activations[other.tolist(), :], 0.0, 0.0)
    if ankle:
        pull = ca.sum1(forces[calf(muscles.names), :]) + SOLEUS_N * v.soleus
        beyond = CALF_ARM_M * pull - ca.DM(ankle_moment(walk, shank_m)).T
        rows.add(0.1 * in_newtons("knee_flexion") * beyond, 0.0, np.inf)
    if activation_dynamics:
        rows.add(activation_rows(ca.vertcat(v.activations, v.soleus), walk.time_s), 0.0, np.inf)
    if compliant_tendons:
        moved = equilibrium_rows(muscles, walk.lengths_m, walk.time_s, v.activations, v.tensions)
        rows.add(10.0 * moved, 0.0, 0.0)
    g, lower_g, upper_g = rows.together()
    x, cost = ca.vec(v.together), _cost(v, muscles, exponent, by_volume)
    start, lower, upper = _start_and_bounds(v, knee, poses, muscles, capacity, least_activation)
    return MuscleContact(
        contact_model,
        walk,
        balanced,
        knee.free,
        muscles,
        capacity,
        {"x": x, "p": ca.vec(resting), "f": cost, "g": g},
        lower=lower.ravel(),
        upper=upper.ravel(),
        lower_g=lower_g,
        upper_g=upper_g,
        start=start.ravel(),
        solution=ca.Function("solution", [x], [v.activations, knee.pose, forces, stand_ins, v.soleus, patella]),
        extensor=extensor,
    )


def _forces(v: _Variables, muscles: MuscleParameters, capacity: ForceCapacity) -> ca.MX:
    """Forces along the tendons (m, n) [N]: linear in the activations, or where tendons are compliant their tensions."""
    if v.tensions.numel():
        return ca.repmat(ca.DM(muscles.max_isometric_force_n), 1, v.tensions.shape[1]) * v.tensions
    return ca.DM(capacity.active_n.T) * v.activations + ca.DM(capacity.passive_n.T)


def _cost(v: _Variables, muscles: MuscleParameters, exponent: float, by_volume: bool) -> ca.MX:
    """Σ w·a^p + Σ (r/size)², soleus among the activations at the weight 1."""
    volumes = muscles.max_isometric_force_n * muscles.optimal_fibre_length_m
    weights = volumes / volumes.mean() if by_volume else np.ones(len(volumes))
    effort = ca.dot(ca.DM(weights), ca.sum2(v.activations**exponent))
    return effort + ca.sum2(ca.sum1(v.soleus**exponent)) + ca.sumsqr(v.reserves)


def _start_and_bounds(
    v: _Variables,
    knee: ContactFrames,
    poses: Array,
    muscles: MuscleParameters,
    capacity: ForceCapacity,
    least_activation: float,
) -> Array:
    """Where the variables begin, their lower and their upper bounds (3, n, variables of a frame)."""
    activations, pose, reserves, soleus, tensions, patella = v.rows
    start, lower, upper = table = np.zeros((3, len(poses), v.together.shape[0]))
    for driven in (activations, soleus):
        start[:, driven], lower[:, driven] = max(0.05, least_activation), least_activation
    upper[:, activations], upper[:, soleus] = 1.0, np.inf
    for part, values in zip(table, (knee.variables(poses), knee.lower, knee.upper), strict=True):
        part[:, pose] = values.reshape(len(poses), -1)
    for free in (reserves, patella):
        lower[:, free], upper[:, free] = -np.inf, np.inf
    if v.tensions.numel():
        least, most = tension_bounds()
        lower[:, tensions], upper[:, tensions] = least, most
        begun = (0.05 * capacity.active_n + capacity.passive_n) / muscles.max_isometric_force_n
        start[:, tensions] = np.clip(begun, 10.0 * least, most)
    return table


def _check(
    walk: MuscleWalk, balanced: tuple[str, ...], free: tuple[str, ...], exponent: float, least_activation: float
) -> None:
    walk.check_has(tuple(dict.fromkeys(("knee_ty", *balanced))))  # knee_ty says what keeps the sides closed
    if not balanced or len(set(balanced)) != len(balanced):
        raise ValueError(f"balanced is {balanced}, expected coordinates, each named once")
    if not set(FREE) <= set(free) <= set(MAY_MOVE) or len(set(free)) != len(free):
        raise ValueError(f"free is {free}, expected ty and rx, and by choice tx and tz, each named once")
    needed = {COORDINATES[name] for name in balanced}
    if not set(free) <= needed:
        raise ValueError(f"{', '.join(set(free) - needed)} is free, but nothing balanced moves along it")
    if not 2.0 <= exponent < np.inf or not 0.0 <= least_activation < 1.0:
        raise ValueError(
            f"exponent is {exponent} and least activation {least_activation}, expected >= 2 and from 0 to below 1"
        )
