"""Muscles drive a knee forward: activations over a cycle in, motion and contact loads out.

The counterpart of `problems.muscle_contact`, whose activations it takes: what balances there moves here, in the
coordinates q = (ty, rx, rz) that it balances,

    M·q̈ = Σ_m arm_m·F_m(a_m(t), l_m, v_m) + contact(q) + load(t) - c·q̇
    load = M·q̈_ref - inverse dynamics,   q_ref = (0, 0, rz of the walk)

so that inverse dynamics, which hold the inertia of the walk, leave it out again. Muscles answer to a flexion that
differs by δ = rz - rz_ref: a musculotendon's length is that of the walk less arm·δ, its velocity less arm·δ̇. tx, tz and
ry stand where they stand in the inverse solution. Curves between frames are cubic splines. M and c are diagonal and
stated in `Leg`; nothing but muscles and contact holds the flexion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import two_digits
from casadi_contact.optimisation.joint_mechanics import generalised_forces, wrench_function
from casadi_contact.optimisation.knee import check_knee
from casadi_contact.optimisation.muscle import (
    MAX_FIBRE_SPEED_PER_S,
    MuscleParameters,
    active_force_length,
    force_capacity,
    force_velocity,
    passive_force_length,
)
from casadi_contact.optimisation.muscle_contact import MuscleContact, MuscleContactResult, MuscleSettings
from problems.common.outcome import rows_in_words

POWERS = ("muscles", "contact", "load", "damping")
_ORDER = (1, 3, 5)  # ty, rx and rz among pose parameters; `BALANCED` has them in this order
_FEWEST_FRAMES = 4  # a cubic spline goes through
_LARGEST_RESERVE = 0.1  # N, N·m: more, and muscles and contact alone do not drive the motion

BALANCED = MuscleSettings().balanced


@dataclass(frozen=True)
class Leg:
    """What moves, for (ty, rx, rz): mass and moments of inertia, dampers. In ty and rx it is the seating of the femur,
    whose forces contact outweighs a hundredfold (halve the dampers, and what loads differ from the inverse solution
    halves); in flexion shank and foot of the usual adult about the knee, without a damper."""

    mass_kg: float = 5.0
    inertia_kgm2: tuple[float, float] = (0.02, 0.35)
    damping_ns_per_mm: float = 1.0
    damping_nmms_per_rad: tuple[float, float] = (1000.0, 0.0)

    @property
    def inertia(self) -> Array:
        """Diagonal of M (3,) [t, t·mm², t·mm²], so that N = t·mm/s²."""
        return np.array([1e-3 * self.mass_kg, *(1e3 * i for i in self.inertia_kgm2)])

    @property
    def damping(self) -> Array:
        """Diagonal c (3,) [N·s/mm, N·mm·s/rad, N·mm·s/rad]."""
        return np.array([self.damping_ns_per_mm, *self.damping_nmms_per_rad])


@dataclass(frozen=True)
class MuscleDriven:
    """Equations that can be looked at unsolved. rate: (state (6), t) -> d state/dt, of (ty, rx, rz) and their rates;
    powers: (state, t) -> `POWERS` [N·mm/s]; pose: (state, t) -> pose (6); contact: pose -> wrench on the insert (6);
    flexion: t -> rz_ref, its speed and acceleration."""

    model: ContactModel
    inverse: MuscleContact
    solved: MuscleContactResult
    leg: Leg
    contact: ca.Function
    rate: ca.Function
    powers: ca.Function
    pose: ca.Function
    flexion: ca.Function

    @property
    def time_s(self) -> Array:
        """Times (n,) of the walk's frames."""
        return self.inverse.walk.time_s

    def start(self) -> Array:
        """State (6,) in the inverse solution's first pose, at its flexion's speed."""
        return np.concatenate([self.solved.poses[0, _ORDER], [0.0, 0.0, float(self.flexion(self.time_s[0])[1])]])

    def dae(self) -> dict[str, Any]:
        """x, t, ode and quad (powers) for casadi.integrator."""
        x, t = ca.MX.sym("x", 6), ca.MX.sym("t")
        return {"x": x, "t": t, "ode": self.rate(x, t), "quad": self.powers(x, t)}


def build(
    model: ContactModel, inverse: MuscleContact, solved: MuscleContactResult, leg: Leg | None = None
) -> MuscleDriven:
    """Equations of motion on a surrogate, a foundation or any contact model.

    Raises ValueError for too few frames, an inverse solution with frames that muscles do not balance, with isometric
    muscles or other balanced coordinates than `BALANCED`, and for a model of no knee with two sides.
    """
    check_knee("a knee driven by muscles", model.scene, model.load_names)
    _check_drivable(inverse, solved)
    leg, walk = Leg() if leg is None else leg, inverse.walk
    contact, count = wrench_function(model), len(walk.muscles.names)
    table = [solved.activations, walk.lengths_m, walk.velocities_m_per_s]
    table += [walk.arms[name] for name in BALANCED]
    table += [np.column_stack([walk.loads[name] for name in BALANCED]), solved.poses[:, [0, 2, 4]]]
    flexion = CubicSpline(walk.time_s, walk.rz)
    table.append(np.column_stack([flexion(walk.time_s, order) for order in range(3)]))
    curves = _spline(walk.time_s, np.hstack(table))

    # Everything but contact and splines is scalar algebra: SX functions, called as one node each.
    now, state, wrench = ca.SX.sym("now", curves.numel_out(0)), ca.SX.sym("state", 6), ca.SX.sym("wrench", 6)
    ends = np.cumsum([0, *[count] * 6, 3, 3, 3]).tolist()
    a, length, velocity, *arms, inverse_dynamics, held, flexion_now = ca.vertsplit(now, ends)
    rz, rz_speed, rz_acceleration = ca.vertsplit(flexion_now)
    at, speed, inertia = state[:3], state[3:], ca.DM(leg.inertia)
    pose = ca.vertcat(held[0], at[0], held[1], at[1], held[2], at[2])
    forces = _forces(inverse.muscles, a, length - arms[2] * (at[2] - rz), velocity - arms[2] * (speed[2] - rz_speed))
    in_nmm = ca.DM([1.0, 1e3, 1e3])
    pull = in_nmm * ca.vertcat(*(ca.dot(arm, forces) for arm in arms))
    push = -generalised_forces(pose, wrench)[list(_ORDER)]
    load = inertia * ca.vertcat(0.0, 0.0, rz_acceleration) - in_nmm * inverse_dynamics
    lost = -ca.DM(leg.damping) * speed
    at_work = (pull, push, load, lost)
    posed = ca.Function("posed", [now, state], [pose])
    moved = ca.Function("moved", [now, state, wrench], [ca.vertcat(speed, sum(at_work[1:], pull) / inertia)])
    worked = ca.Function("worked", [now, state, wrench], [ca.vertcat(*(ca.dot(force, speed) for force in at_work))])

    x, t = ca.MX.sym("x", 6), ca.MX.sym("t")
    given = curves(t)
    touching = contact(posed(given, x))
    return MuscleDriven(
        model=model,
        inverse=inverse,
        solved=solved,
        leg=leg,
        contact=contact,
        rate=ca.Function("rate", [x, t], [moved(given, x, touching)]),
        powers=ca.Function("powers", [x, t], [worked(given, x, touching)]),
        pose=ca.Function("pose", [x, t], [posed(given, x)]),
        flexion=ca.Function("flexion", [t], [given[-3:]]),
    )


def _spline(time_s: Array, values: Array) -> ca.Function:
    """t -> row of values (n, c) at t, by cubic splines."""
    return ca.interpolant("curves", "bspline", [time_s.tolist()], values.ravel().tolist(), {})


def _check_drivable(inverse: MuscleContact, solved: MuscleContactResult) -> None:
    """ValueError for an inverse solution whose motion its activations alone do not bring about."""
    walk = inverse.walk
    if len(walk) < _FEWEST_FRAMES:
        raise ValueError(
            f"walk {walk.name} has {len(walk)} frames, expected at least {_FEWEST_FRAMES}, for cubic splines between "
            "them, and some fifty to follow a step"
        )
    if inverse.settings.balanced != BALANCED:
        raise ValueError(f"{', '.join(inverse.settings.balanced)} are balanced, expected {', '.join(BALANCED)}")
    unbalanced = ~solved.solved
    if unbalanced.any():
        raise ValueError(
            f"walk {walk.name}: muscles alone do not balance frames {rows_in_words(unbalanced)}, expected all of them "
            "to be balanced: problems.muscle_contact says why"
        )
    reserves = np.max([np.abs(curve) for curve in solved.reserves.values()], axis=0)
    if (leaning := reserves > _LARGEST_RESERVE).any():
        raise ValueError(
            f"walk {walk.name}: reserves give up to {two_digits(reserves.max())} N or N·m in frames "
            f"{rows_in_words(leaning)}, at most {_LARGEST_RESERVE} expected, since they drive nothing: give stronger "
            "muscles, or a walk that asks less"
        )
    hill = force_capacity(inverse.muscles, walk.lengths_m, walk.velocities_m_per_s)
    rigid = hill.active_n * solved.activations + hill.passive_n
    if np.abs(solved.muscle_forces_n - rigid).max() > 0.1:
        raise ValueError(
            "tendons are compliant or muscles isometric in the inverse solution, expected rigid Hill muscles"
        )


def _forces(muscles: MuscleParameters, a: ca.SX, length_m: ca.SX, velocity_m_per_s: ca.SX) -> ca.SX:
    """Forces along rigid tendons (m,) [N], as `force_capacity` gives them, where the tendon is taut."""
    optimum = ca.DM(muscles.optimal_fibre_length_m)
    along = length_m - ca.DM(muscles.tendon_slack_length_m)
    fibre_m = ca.sqrt(along**2 + (optimum * ca.DM(np.sin(muscles.pennation_rad))) ** 2)
    cosine, fibre = ca.fmax(along, 0.0) / fibre_m, fibre_m / optimum
    velocity = velocity_m_per_s * cosine / (MAX_FIBRE_SPEED_PER_S * optimum)
    active = a * active_force_length(fibre, ca) * ca.fmax(force_velocity(velocity, ca), 0.0)
    passive = ca.fmax(passive_force_length(fibre, ca), 0.0)
    return ca.DM(muscles.max_isometric_force_n) * cosine * (active + passive)
