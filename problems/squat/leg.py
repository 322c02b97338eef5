"""Mechanics of the planar leg: shank, thigh and trunk on a foot that stays flat, and the forces across the knee.

Segment i leans forward from the vertical by φ_i (shank, thigh, trunk). With a_ki how far along segment i the mass of
segment k lies (its whole length below k, the centre of mass in k itself), c_ij = Σ_k m_k a_ki a_kj (+ I_i) and
G_i = g Σ_k m_k a_ki,

    Σ_j c_ij cos(φ_i - φ_j) φ̈_j + Σ_j c_ij sin(φ_i - φ_j) φ̇_j² - G_i sin φ_i = Q_i        [N·m]

    Q = (M_ankle + M_knee, -M_knee - M_hip, M_hip),  δ = φ_1, κ = φ_1 - φ_2, η = φ_3 - φ_2

The moving origin of the knee is the hinge of thigh and shank; the condyles' small travel moves no mass. Across the knee
the body above is in balance, in the insert's frame (x posterior, y along the shank):

    forces along x, y:   Σ_k m_k (a_k - g) = Σ pulls of muscles + contact - k·tx
    about x:             contact + Σ frontal arm·F = -(vertical ground force)·(lever of the ground force)

where k is the spring of the knee simulator's rig that stands for ligaments, and the lever is how far medially of the
knee the ground force passes, which a planar leg cannot know. tz and ry stay zero. The patellar tendon pulls forward of
the shank's axis by 20° in extension and along it at 75° of flexion, a straight line of the size that Herzog and Read,
J Anat 182 (1993) 213-230, measured; hamstrings pull along the thigh, gastrocnemii along the shank.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.optimisation import generalised_forces
from casadi_contact.optimisation.muscle import (
    MAX_FIBRE_SPEED_PER_S,
    active_force_length,
    force_velocity,
    passive_force_length,
)
from problems.knee_simulator.rig import Rig
from problems.squat.muscles import MUSCLES, QUADRICEPS, SHANK, THIGH, column

GRAVITY = 9.81
_LARGEST_LEVER_MM = 200.0  # half the width of a stance
_TENDON_FORWARD_RAD, _TENDON_ALONG_RAD = np.radians(20.0), np.radians(75.0)


@dataclass(frozen=True)
class Body:
    """One leg under half of the trunk: masses and lengths after Winter, Biomechanics and Motor Control of Human
    Movement (shank, thigh, head-arms-trunk; each centre of mass from the lower end), as shares of mass and height."""

    mass_kg: float = 75.0
    height_m: float = 1.75
    adduction_lever_mm: float = 20.0
    heel_m: float = -0.05
    toe_m: float = 0.15
    ankle_height_m: float = 0.07

    def __post_init__(self) -> None:
        if not (0.0 < self.mass_kg < np.inf and 0.0 < self.height_m < np.inf and self.heel_m < self.toe_m):
            raise ValueError(
                f"mass {self.mass_kg} kg, height {self.height_m} m, heel {self.heel_m} and toe {self.toe_m} m: "
                "expected positive sizes, and the toe ahead of the heel"
            )
        if not abs(self.adduction_lever_mm) <= _LARGEST_LEVER_MM:
            raise ValueError(
                f"the ground force passes {self.adduction_lever_mm} mm medially of the knee, expected "
                f"-{_LARGEST_LEVER_MM:g} to {_LARGEST_LEVER_MM:g} mm"
            )

    @property
    def weight_n(self) -> float:
        """Weight of the whole body."""
        return self.mass_kg * GRAVITY

    @property
    def masses_kg(self) -> Array:
        """Shank, thigh, half of the trunk (3,)."""
        return self.mass_kg * np.array([0.0465, 0.100, 0.5 * 0.678])

    @property
    def lengths_m(self) -> Array:
        """Of the three segments (3,)."""
        return self.height_m * np.array([0.246, 0.245, 0.288])

    @property
    def centres_m(self) -> Array:
        """From the lower end to the centre of mass (3,)."""
        return self.lengths_m * np.array([0.567, 0.567, 0.626])

    @property
    def inertias_kgm2(self) -> Array:
        """About the centres of mass (3,)."""
        return self.masses_kg * (self.lengths_m * np.array([0.302, 0.323, 0.496])) ** 2

    @property
    def along_m(self) -> Array:
        """a_ki (3, 3): how far along segment i the mass of segment k lies."""
        below = np.tril(np.tile(self.lengths_m, (3, 1)), -1)
        return below + np.diag(self.centres_m)


@dataclass(frozen=True)
class LegMechanics:
    """functions of one moment.

    residuals: (φ (3), φ̇ (3), φ̈ (3), activations (m), pose of the knee (6), wrench on the insert (6)) -> equations of
    motion (3) [N·m], forces x, y [N] and moment about x [N·m] left across the knee (3), ground force (2) [N], and how
    far the centre of pressure lies within heel and toe, times the ground force (2) [N·m].
    muscle_forces: (φ, φ̇, activations) -> (m) [N].
    """

    body: Body
    residuals: ca.Function
    muscle_forces: ca.Function

    @classmethod
    def of(cls, body: Body) -> LegMechanics:
        """The equations of a body."""
        phi, rate, bend = (ca.SX.sym(name, 3) for name in ("phi", "rate", "acceleration"))
        a, pose, wrench = ca.SX.sym("a", len(MUSCLES)), ca.SX.sym("pose", 6), ca.SX.sym("wrench", 6)
        forces = _muscle_forces(phi, rate, a)
        hip, knee, ankle = (ca.dot(ca.DM(column(name)), forces) for name in ("hip_m", "knee_m", "ankle_m"))
        contact = generalised_forces(pose, wrench)  # on the insert; on the femur the opposite
        bending = -knee + 1e-3 * contact[5]  # flexion is -rz
        Q = ca.vertcat(ankle + bending, -bending - hip, hip)
        along, masses = body.along_m, body.masses_kg
        c = along.T @ np.diag(masses) @ along + np.diag(body.inertias_kgm2)
        apart = ca.repmat(phi, 1, 3) - ca.repmat(phi.T, 3, 1)
        inertial = ca.mtimes(ca.DM(c) * ca.cos(apart), bend) + ca.mtimes(ca.DM(c) * ca.sin(apart), rate**2)
        motion = inertial - GRAVITY * ca.DM(along.T @ masses) * ca.sin(phi) - Q
        forward = ca.cos(phi) * bend - ca.sin(phi) * rate**2  # of a point 1 m along each segment
        upward = -ca.sin(phi) * bend - ca.cos(phi) * rate**2
        push = ca.horzcat(ca.mtimes(ca.DM(along), forward), ca.mtimes(ca.DM(along), upward) + GRAVITY)  # a_k - g
        push = ca.DM(masses) * push
        ground, above = ca.sum1(push).T, ca.sum1(push[1:, :]).T
        s, co = ca.sin(phi[0]), ca.cos(phi[0])
        carried = ca.vertcat(-co * above[0] + s * above[1], s * above[0] + co * above[1])
        spring = ca.vertcat(Rig().ap_spring_n_per_mm * pose[0], 0.0)
        across = _pulls(phi[0] - phi[1], forces) - wrench[:2] - spring - carried
        frontal = ca.dot(ca.DM(column("frontal_m")), forces) + 1e-3 * body.adduction_lever_mm * ground[1]
        lean = -(ankle + body.ankle_height_m * ground[0])  # centre of pressure times vertical force
        within = ca.vertcat(lean - body.heel_m * ground[1], body.toe_m * ground[1] - lean)
        left = ca.vertcat(across, frontal - 1e-3 * contact[3])
        given = [phi, rate, bend, a, pose, wrench]
        return cls(
            body,
            ca.Function("leg", given, [motion, left, ground, within]),
            ca.Function("muscles", [phi, rate, a], [forces]),
        )


def _muscle_forces(phi: ca.SX, rate: ca.SX, a: ca.SX) -> ca.SX:
    """Forces along the tendons (m) [N]."""

    def shortening(angles: ca.SX) -> ca.SX:
        dorsiflexion, flexion, hip_flexion = angles[0], angles[0] - angles[1], angles[2] - angles[1]
        hip, knee, ankle = (ca.DM(column(name)) for name in ("hip_m", "knee_m", "ankle_m"))
        return hip * hip_flexion - knee * flexion + ankle * dorsiflexion

    optimal = ca.DM(column("fibre_m"))
    fibre = (ca.DM(column("length_m") - column("tendon_m")) - shortening(phi)) / optimal
    speed = -shortening(rate) / (MAX_FIBRE_SPEED_PER_S * optimal)
    active = active_force_length(fibre, ca) * force_velocity(speed, ca)
    return ca.DM(column("force_n")) * (a * active + passive_force_length(fibre, ca))


def _pulls(flexion: ca.SX, forces: ca.SX) -> ca.SX:
    """Force of all muscles on the body above the knee along x and y of the insert (2) [N]."""
    lean = _TENDON_FORWARD_RAD * (1.0 - flexion / _TENDON_ALONG_RAD)
    along = {
        QUADRICEPS: ca.vertcat(ca.sin(lean), -ca.cos(lean)),
        THIGH: -ca.vertcat(ca.sin(flexion), ca.cos(flexion)),
        SHANK: ca.DM([0.0, -1.0]),
    }
    crossing = ((along[m.along], forces[k]) for k, m in enumerate(MUSCLES.values()) if m.along is not None)
    return sum((direction * force for direction, force in crossing), ca.SX.zeros(2))
