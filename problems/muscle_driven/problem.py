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

from casadi_contact.contact import ContactModel
from casadi_contact.conventions import Array
from casadi_contact.optimisation import generalised_forces, wrench_function
from problems.muscle_contact.muscle import (
    MAX_FIBRE_SPEED_PER_S,
    MuscleParameters,
    active_force_length,
    force_velocity,
    passive_force_length,
)
from problems.muscle_contact.problem import BALANCED, MuscleContact
from problems.muscle_contact.solve import MuscleContactResult

POWERS = ("muscles", "contact", "load", "damping")
_ORDER = (1, 3, 5)  # ty, rx and rz among pose parameters; `BALANCED` has them in this order
_LARGEST_RESERVE = 0.1  # N, N·m: more, and muscles and contact alone do not drive the motion


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
    powers: (state, t) -> `POWERS` [N·mm/s]; pose: (state, t) -> pose (6); contact: pose ->
    wrench on the insert (6), kept because callbacks must live; flexion: t -> rz_ref, its speed and acceleration."""

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

    Raises ValueError for an inverse solution with frames that muscles do not balance, compliant tendons, or other
    balanced coordinates than `BALANCED`.
    """
    leg, walk = Leg() if leg is None else leg, inverse.walk
    if inverse.balanced != BALANCED or not solved.converged.all() or solved.overloaded.any():
        raise ValueError(f"walk {walk.name}: expected {', '.join(BALANCED)} balanced in every frame by muscles alone")
    if max(np.abs(curve).max() for curve in solved.reserves.values()) > _LARGEST_RESERVE:
        raise ValueError(
            f"walk {walk.name}: reserves give more than {_LARGEST_RESERVE}, expected muscles to balance it"
        )
    rigid = inverse.capacity.active_n * solved.activations + inverse.capacity.passive_n
    if np.abs(solved.muscle_forces_n - rigid).max() > 0.1:
        raise ValueError(
            "tendons are compliant or muscles isometric in the inverse solution, expected rigid Hill muscles"
        )
    contact, count = wrench_function(model), len(walk.muscles.names)
    table = [solved.activations, walk.lengths_m, walk.velocities_m_per_s]
    table += [walk.arms[name] for name in BALANCED]
    table += [np.column_stack([walk.loads[name] for name in BALANCED]), solved.poses[:, [0, 2, 4]]]
    curves, flexion = _spline(walk.time_s, np.hstack(table)), _flexion(walk.time_s, walk.rz)

    given, delta, rate = ca.SX.sym("given", 6 * count + 6), ca.SX.sym("delta"), ca.SX.sym("rate")
    a, length, velocity, *arms, _ = ca.vertsplit(given, np.cumsum([0, *[count] * 6, 6]).tolist())
    forces = _forces(inverse.muscles, a, length - arms[2] * delta, velocity - arms[2] * rate)
    pulls = ca.vertcat(*(ca.dot(arm, forces) for arm in arms)) * ca.DM([1.0, 1e3, 1e3])
    muscles = ca.Function("muscles", [given, delta, rate], [pulls])

    x, t = ca.MX.sym("x", 6), ca.MX.sym("t")
    now, (rz, rz_speed, rz_acceleration) = curves(t), ca.vertsplit(flexion(t))
    inverse_dynamics, held = now[6 * count : 6 * count + 3], now[6 * count + 3 :]
    pose = ca.vertcat(held[0], x[0], held[1], x[1], held[2], x[2])
    inertia = ca.DM(leg.inertia)
    pull = muscles(now, x[2] - rz, x[5] - rz_speed)
    push = -generalised_forces(pose, contact(pose))[list(_ORDER)]
    load = inertia * ca.vertcat(0.0, 0.0, rz_acceleration) - inverse_dynamics * ca.DM([1.0, 1e3, 1e3])
    lost = -ca.DM(leg.damping) * x[3:]
    forces_at_work = (pull, push, load, lost)
    acceleration = sum(forces_at_work[1:], pull) / inertia
    return MuscleDriven(
        model=model,
        inverse=inverse,
        solved=solved,
        leg=leg,
        contact=contact,
        rate=ca.Function("rate", [x, t], [ca.vertcat(x[3:], acceleration)]),
        powers=ca.Function("powers", [x, t], [ca.vertcat(*(ca.dot(force, x[3:]) for force in forces_at_work))]),
        pose=ca.Function("pose", [x, t], [pose]),
        flexion=flexion,
    )


def _spline(time_s: Array, values: Array) -> ca.Function:
    """t -> row of values (n, c) at t, by cubic splines."""
    return ca.interpolant("curves", "bspline", [time_s.tolist()], values.ravel().tolist(), {})


def _flexion(time_s: Array, rz: Array) -> ca.Function:
    """t -> rz, its first and second derivative, of a cubic spline."""
    t = ca.MX.sym("t")
    at = _spline(time_s, rz[:, None])(t)
    speed = ca.jacobian(at, t)
    return ca.Function("flexion", [t], [ca.vertcat(at, speed, ca.jacobian(speed, t))])


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
