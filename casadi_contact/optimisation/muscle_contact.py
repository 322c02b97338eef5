"""Muscle and contact forces of a knee together, over a whole walking cycle, from inverse dynamics.

Muscles pull the femur onto the tibia, contact pushes back, and both balance the knee's inverse-dynamics loads. For all
frames at once, activations a (13), free pose parameters q (ty and rx; tx and tz by choice) and reserve loads r:

    min Σ a^p + Σ (r/size)²        p = 3: endurance (Crowninshield and Brand, J Biomech 14 (1981) 793-801)

    Σ_m arm_m·F_m(a_m) + contact(q) + r = inverse dynamics        for each balanced coordinate
    s_med(q), s_lat(q) >= √(least/N0),   least activation <= a <= 1,   q in the learned range

F is linear in a (`rigid_tendon_forces`). contact(q) is the contact model's generalised load on the femur
(`knee.contact_on_femur`), s the signed root load. tx and tz, where they are not free, stand where equal forces on
both sides cause no shear; ry and rz are prescribed. Measured contact forces enter nowhere. Co-contraction follows from
three rules, each by choice:

- Heads of one muscle have one nerve and share an activation.
- Antagonists keep both sides of the knee closed (Schipplein and Andriacchi, J Orthop Res 9 (1991) 113-119). Each side
  carries at least N_side = knee_ty·Δ/w: what keeps it loaded when the load passes Δ beside its place, w being the
  distance of the sides [mm].
- The calf works for the ankle. Its moment follows from the knee's inverse dynamics at the shank's length L, without
  weight and inertia of shank and foot: M = L·knee_tx - knee_flexion [N·m], plantarflexion positive. Gastrocnemius and
  soleus give at least this, r·(F_gas + F_sol) >= M; soleus' activation is one more variable.
"""

import itertools
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.ipopt import FrameOutcome, FrameResult, IpoptOutcome, ipopt_options
from casadi_contact.optimisation.knee import (
    COORDINATES,
    KNEE_LOADS,
    check_knee,
    contact_on_femur,
    in_newtons,
    shear_free_poses,
)
from casadi_contact.optimisation.muscle import MuscleWalk, rigid_tendon_forces

# They stand in for ligaments and errors of inverse dynamics. Contact alone balances ty and adduction, and muscles
# balance flexion: reserves there only keep an overloaded frame solvable.
RESERVE_SIZES = dict(zip(COORDINATES, (100.0, 10.0, 100.0, 1.0, 10.0, 1.0), strict=True))


@dataclass(frozen=True)
class MuscleSettings:
    """Choices of the muscle problem.

    exponent p >= 2 of activations in the cost; margin_mm: Δ of closed sides, 20 mm being two standard deviations of
    where the load passes the knee from step to step; shank_m: knee to ankle; calf_arm_m: of the Achilles tendon about
    the ankle; soleus_n: its greatest force along the tendon (Arnold et al., Ann Biomed Eng 38 (2010) 269-279);
    balanced: coordinates of `COORDINATES`; free: ty, rx, and by choice tx and tz; reserve_sizes: reserves [N, N·m] that
    cost as much as one full activation; tolerance_n: of a balanced coordinate."""

    exponent: float = 3.0
    least_activation: float = 0.01
    margin_mm: float = 20.0
    share_heads: bool = True
    ankle: bool = True
    shank_m: float = 0.41
    calf_arm_m: float = 0.045
    soleus_n: float = 3585.9 * float(np.cos(np.deg2rad(28.3)))
    balanced: tuple[str, ...] = ("knee_ty", "knee_adduction", "knee_flexion")
    free: tuple[str, ...] = ("ty", "rx")
    reserve_sizes: Mapping[str, float] = field(default_factory=RESERVE_SIZES.copy)
    tolerance_n: float = 0.1

    def __post_init__(self) -> None:
        if not 2.0 <= self.exponent < np.inf or not 0.0 <= self.least_activation < 1.0:
            got = f"exponent is {self.exponent} and least activation {self.least_activation}"
            raise ValueError(f"{got}, expected at least 2, and 0 to below 1")
        if not {"ty", "rx"} <= set(self.free) <= {"tx", "ty", "tz", "rx"}:
            raise ValueError(f"free is {self.free}, expected ty and rx, and by choice tx and tz")
        moving = {COORDINATES.get(name) for name in self.balanced}
        if not set(self.free) <= moving or None in moving:
            raise ValueError(f"balanced is {self.balanced}, expected coordinates that move {', '.join(self.free)}")


@dataclass(frozen=True)
class MuscleContactResult(FrameResult):
    """Activations and forces along the tendons (n, m), poses (n, 6), contact loads (n, 7) as in `KNEE_LOADS`, reserves
    and what is left of each balance [N, N·m] by coordinate, soleus' activation (n,) where the ankle counts. A frame is
    OVERLOADED where a reserve gives more than its size, or soleus more than it can."""

    activations: Array
    muscle_forces_n: Array
    poses: Array
    loads: Array
    reserves: Mapping[str, Array]
    unbalanced: Mapping[str, Array]
    soleus: Array | None


class MuscleContact:
    """The problem over all frames of a walk, which can be inspected unsolved.

        problem = MuscleContact(cc.load_surrogate("knee"), walk)
        result = problem.solve()

    nlp: CasADi's x, f and g; lower, upper, lower_g, upper_g, start: bounds and start. Variables of a frame, scaled:
    activations, free pose parameters, reserves over their sizes, and soleus' activation, which is not held below 1.
    solution: x -> activations (m, n), poses (6, n), forces (m, n) [N], contact and reserves (b, n)
    [N, N·m], soleus (0 or 1, n).
    Raises ValueError for a model of no knee with two sides and a walk without the coordinates that are needed."""

    def __init__(
        self, contact_model: SymbolicContact, walk: MuscleWalk, settings: MuscleSettings | None = None
    ) -> None:
        settings = settings or MuscleSettings()
        check_knee("a muscle problem", contact_model.scene, contact_model.load_names)
        walk.check_has(dict.fromkeys(("knee_ty", *settings.balanced)))
        self.contact_model, self.walk, self.settings = contact_model, walk, settings
        self.muscles = walk.muscles.fitted_to(walk.lengths_m)
        self.active_n, passive_n, _ = rigid_tendon_forces(self.muscles, walk.lengths_m, walk.velocities_m_per_s)
        frames, balanced = len(walk), settings.balanced

        sizes = (len(self.muscles.names), len(settings.free), len(balanced), int(settings.ankle))
        ends = [0, *itertools.accumulate(sizes)]
        x = ca.MX.sym("x", ends[-1], frames)
        a, q, r, soleus = ca.vertsplit(x, ends)
        poses = shear_free_poses(contact_model, walk.ry, walk.rz)
        locked = {name: poses[:, k] for k, name in enumerate(POSE_NAMES) if name not in settings.free}
        knee = ContactFrames(contact_model, frames, locked=locked, loads=KNEE_LOADS, variable=lambda *_: q)
        forces = ca.DM(self.active_n.T) * a + ca.DM(passive_n.T)
        reserves = ca.mtimes(ca.diag(ca.DM([settings.reserve_sizes[name] for name in balanced])), r)

        constraints: list[tuple[ca.MX, Array | float, float]] = []  # low <= expression <= high
        at, loads = ca.MX.sym("pose", 6), ca.MX.sym("loads", len(KNEE_LOADS))
        on_femur = contact_on_femur(at, loads)
        of_frame = ca.Function("contact", [at, loads], [ca.vertcat(*(on_femur[name] for name in balanced))])
        contact = of_frame.map(frames)(knee.pose, knee.loads)
        for row, name in enumerate(balanced):
            pull = ca.sum1(ca.DM(walk.arms[name].T) * forces)
            left = pull + contact[row, :] + reserves[row, :] - ca.DM(walk.loads[name]).T
            constraints.append((0.1 * in_newtons(name) * left, 0.0, 0.0))
        constraints.append((knee.roots, closed_sides(contact_model, walk.loads["knee_ty"], settings.margin_mm), np.inf))
        if settings.share_heads:
            for first, *others in (columns_of(self.muscles.names, "vas"), columns_of(self.muscles.names, "gas")):
                constraints += [(a[first, :] - a[other, :], 0.0, 0.0) for other in others]
        if settings.ankle:
            calf = ca.sum1(forces[columns_of(self.muscles.names, "gas"), :]) + settings.soleus_n * soleus
            beyond = settings.calf_arm_m * calf - ca.DM(ankle_moment(walk, settings.shank_m)).T
            constraints.append((0.1 * in_newtons("knee_flexion") * beyond, 0.0, np.inf))
        bounds = [
            [np.broadcast_to(bound, expression.shape[::-1]).ravel() for bound in (low, high)]
            for expression, low, high in constraints
        ]
        self.lower_g, self.upper_g = np.concatenate(bounds, axis=1)

        effort = ca.sum2(ca.sum1(a**settings.exponent)) + ca.sum2(ca.sum1(soleus**settings.exponent))
        g = ca.vertcat(*(ca.vec(expression) for expression, _, _ in constraints))
        self.nlp: dict[str, Any] = {"x": ca.vec(x), "f": effort + ca.sumsqr(r), "g": g}
        self.solution = ca.Function("solution", [ca.vec(x)], [a, knee.pose, forces, contact, reserves, soleus])

        start, lower, upper = (np.zeros((frames, ends[-1])) for _ in range(3))
        activations, pose, reserve, driven = (slice(*pair) for pair in itertools.pairwise(ends))
        for part in (activations, driven):
            start[:, part], lower[:, part] = max(0.05, settings.least_activation), settings.least_activation
        upper[:, activations], upper[:, driven] = 1.0, np.inf
        for table, values in ((start, knee.variables(poses)), (lower, knee.lower), (upper, knee.upper)):
            table[:, pose] = values.reshape(frames, -1)
        lower[:, reserve], upper[:, reserve] = -np.inf, np.inf
        self.start, self.lower, self.upper = start.ravel(), lower.ravel(), upper.ravel()

    def solve(self, max_iterations: int = 500) -> MuscleContactResult:
        """Solve with IPOPT and its exact Hessian. Frames that do not converge are reported, never raised."""
        began, options = time.perf_counter(), ipopt_options(tolerance=1e-7, max_iterations=max_iterations)
        solver = ca.nlpsol("muscle_contact", "ipopt", self.nlp, options)
        answer = solver(x0=self.start, lbx=self.lower, ubx=self.upper, lbg=self.lower_g, ubg=self.upper_g)
        seconds, ipopt = time.perf_counter() - began, IpoptOutcome.of(solver)
        parts = [np.asarray(part).T for part in self.solution(answer["x"])]
        activations, poses, forces, contact, reserves, soleus = parts

        walk, settings = self.walk, self.settings
        loads = self.contact_model(poses, KNEE_LOADS)
        given = dict(zip(settings.balanced, reserves.T, strict=True))
        left = {
            name: (walk.arms[name] * forces).sum(axis=1) + on_femur + given[name] - walk.loads[name]
            for name, on_femur in zip(settings.balanced, contact.T, strict=True)
        }
        worst_n = np.abs([in_newtons(name) * curve for name, curve in left.items()]).max(axis=0)
        shares = [np.abs(curve) / settings.reserve_sizes[name] for name, curve in given.items()]
        solved = (worst_n <= settings.tolerance_n) & ipopt.solved
        overloaded = solved & (np.max([*shares, *soleus.T], axis=0) > 1.0)
        outcome = FrameOutcome.of(solved, (overloaded, FrameOutcome.OVERLOADED))
        calf = soleus[:, 0] if soleus.size else None
        found = (activations, forces, poses, loads, given, left, calf)
        return MuscleContactResult(*found, outcome=outcome, ipopt=ipopt, seconds=seconds)


def columns_of(names: tuple[str, ...], *parts: str) -> list[int]:
    """Columns of muscles whose names hold one of the parts, as usual leg models have them (vas, gas, recf, rect_f);
    ValueError where there are none."""
    columns = [column for column, name in enumerate(names) if any(part in name.lower() for part in parts)]
    if not columns:
        said = f"muscles are {', '.join(names)}, expected some named with {' or '.join(parts)}"
        raise ValueError(f"{said}: or leave out the rules that need them (share_heads=False, ankle=False)")
    return columns


def closed_sides(model: SymbolicContact, knee_ty: Array, margin_mm: float) -> Array:
    """Least root loads (n, patches): s = √(N/N0) of N = max(knee_ty, 0)·Δ/w."""
    places = model.scene.anchors_mm[:, 2]
    if not 0.0 <= margin_mm <= np.ptp(places):
        raise ValueError(f"margin is {margin_mm} mm, expected 0 to {np.ptp(places):.3g}, the distance of the sides")
    least_n = np.maximum(knee_ty, 0.0) * margin_mm / np.ptp(places)
    return np.tile(np.sqrt(least_n / model.scene.reference_load)[:, None], (1, len(places)))


def ankle_moment(walk: MuscleWalk, shank_m: float) -> Array:
    """Plantarflexion moment (n,) [N·m] that inverse dynamics of the knee implies: M = L·knee_tx - knee_flexion."""
    walk.check_has(("knee_tx", "knee_flexion"))
    if not 0.2 <= shank_m <= 0.6:
        raise ValueError(f"shank is {shank_m} m long, expected 0.2 to 0.6 m from knee to ankle")
    return np.asarray(shank_m * walk.loads["knee_tx"] - walk.loads["knee_flexion"])
