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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS, check_knee, shear_free_poses
from casadi_contact.optimisation.muscle import ForceCapacity, MuscleParameters, force_capacity
from casadi_contact.optimisation.muscle_walk import MuscleWalk
from problems.muscle_contact.cocontraction import SHANK_M
from problems.muscle_contact.constraints import (
    Constraints,
    Frames,
    balance_femur,
    balance_patella,
    cocontract,
    follow_muscles,
)
from problems.muscle_contact.extensor import Extensor
from problems.muscle_contact.variables import Variables

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
    cycles (k, m). balanced: coordinates of `COORDINATES`; free: ty, rx, and by choice tx and tz.
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
    muscles = _fitted(walk, other_lengths_m) if fit_lengths else walk.muscles
    capacity = force_capacity(muscles, walk.lengths_m, walk.velocities_m_per_s, model)
    poses = _shear_free(contact_model, walk)
    count, patellar = len(muscles.names), 0 if extensor is None else len(POSE_NAMES)
    sizes = (count, len(free), len(balanced), int(ankle), count * int(compliant_tendons), patellar)
    v = Variables.of(len(walk), sizes)
    locked = {name: poses[:, k] for k, name in enumerate(POSE_NAMES) if name not in free}
    knee = ContactFrames(contact_model, len(walk), locked=locked, loads=KNEE_LOADS, variable=lambda *_: v.pose)
    frames = Frames(walk, muscles, v, v.forces(muscles, capacity), knee)
    reserves = ca.mtimes(ca.diag(ca.DM([RESERVE_SIZES[name] for name in balanced])), v.reserves)
    resting = ca.MX.sym("resting", patellar, len(walk))

    constraints, by_patella, patella = Constraints(), None, v.patella
    if extensor is not None:
        by_patella, patella = balance_patella(constraints, frames, extensor, resting)
    balance_femur(constraints, frames, balanced, reserves, by_patella)
    cocontract(constraints, frames, margin_mm=margin_mm, share_heads=share_heads, ankle=ankle, shank_m=shank_m)
    follow_muscles(constraints, frames, activation_dynamics=activation_dynamics, compliant_tendons=compliant_tendons)
    g, lower_g, upper_g = constraints.together()
    x = ca.vec(v.together)
    start, lower, upper = v.start_and_bounds(knee, poses, muscles, capacity, least_activation).reshape(3, -1)
    return MuscleContact(
        contact_model,
        walk,
        balanced,
        knee.free,
        muscles,
        capacity,
        {"x": x, "p": ca.vec(resting), "f": v.cost(muscles, exponent, by_volume), "g": g},
        lower=lower,
        upper=upper,
        lower_g=lower_g,
        upper_g=upper_g,
        start=start,
        solution=ca.Function("solution", [x], [v.activations, knee.pose, frames.forces, reserves, v.soleus, patella]),
        extensor=extensor,
    )


def _fitted(walk: MuscleWalk, other_lengths_m: Array | None) -> MuscleParameters:
    """The walk's muscles fitted to its lengths and to the person's others (k, m)."""
    lengths_m = walk.lengths_m if other_lengths_m is None else np.vstack([walk.lengths_m, other_lengths_m])
    return walk.muscles.fitted_to(lengths_m)


def _shear_free(contact_model: SymbolicContact, walk: MuscleWalk) -> Array:
    """Poses (n, 6) at the walk's rotations in which equal forces on both sides cause no shear."""
    try:
        return shear_free_poses(contact_model, walk.ry, walk.rz)
    except ValueError as error:
        raise ValueError(f"walk {walk.name}: {error}") from None


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
