"""Muscles drive a knee forward: activations of a walking cycle in, motion and contact loads out.

    states      q = (ty, rx, rz) [mm, rad] and v = q̇
    inputs      activations a_m(t) that balance the walk's inverse dynamics (`problems.muscle_contact`)
    equations   M·v̇ = Σ_m arm_m·F_m(a_m, l_m, ẋ_m) + contact(q) + load(t) - c·v
                load = M·q̈_ref - inverse dynamics,   q_ref = (0, 0, rz of the walk)

so that inverse dynamics, which contain the inertia of the walk, leave it out again. A muscle is as long as in the walk
less arm·(rz - rz_ref), and its velocity is that of the walk less arm·(ṙz - ṙz_ref). tx, tz and ry follow the inverse
solution. Curves between frames are cubic splines. Nothing but muscles and contact holds the flexion.

CVODES integrates with the exact Jacobian, on a surrogate and on the foundation of its scene. The energy
balance checks the integrator: all work done is kinetic energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

import casadi_contact as cc
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.joint_mechanics import generalised_forces
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.optimisation.muscle import rigid_tendon_forces
from casadi_contact.optimisation.muscle_contact import MuscleContact, MuscleContactResult
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import FOUNDATION, SURROGATE, TARGET, new_page, save_page
from casadi_contact.scenes.pose_file import write_poses
from problems.contact_source import wrench_function
from problems.knee_simulator import integrated
from problems.muscle_contact import walk_of

BALANCED = ("knee_ty", "knee_adduction", "knee_flexion")  # the coordinates of ty, rx, rz
MOVING = [1, 3, 5]


@dataclass(frozen=True)
class Leg:
    """Diagonals of M [t, t·mm²] and c [N·s/mm, N·mm·s/rad] for (ty, rx, rz). In ty and rx seating of the femur, which
    contact outweighs a hundredfold; in rz shank and foot about the knee, without a damper."""

    inertia: tuple[float, ...] = (5e-3, 20.0, 350.0)  # 5 kg, 0.02 and 0.35 kg·m²
    damping: tuple[float, ...] = (1.0, 1000.0, 0.0)


@dataclass(frozen=True)
class MuscleDriven:
    """CasADi functions of the state x (6) and time: rate: ẋ; powers: of muscles, contact, load and damper [N·mm/s];
    pose (6). start: x at the first frame."""

    rate: ca.Function
    powers: ca.Function
    pose: ca.Function
    start: Array


def build(
    model: ContactModel, inverse: MuscleContact, solved: MuscleContactResult, leg: Leg | None = None
) -> MuscleDriven:
    """Equations of motion on any contact model, driven by the activations of an inverse solution with rigid tendons.

    Raises ValueError for an inverse solution with frames that muscles alone do not balance.
    """
    walk, leg = inverse.walk, leg or Leg()
    if inverse.settings.balanced != BALANCED or not solved.solved.all() or len(walk) < 4:
        raise ValueError(
            f"walk {walk.name}: {int(solved.solved.sum())} of {len(walk)} frames are balanced by muscles alone along "
            f"{', '.join(inverse.settings.balanced)}, expected all, at least 4, along {', '.join(BALANCED)}"
        )
    flexion = CubicSpline(walk.time_s, walk.rz)
    tables = [solved.activations, walk.lengths_m, walk.velocities_m_per_s, *(walk.arms[name] for name in BALANCED)]
    tables += [np.column_stack([walk.loads[name] for name in BALANCED]), solved.poses[:, [0, 2, 4]]]
    tables.append(np.column_stack([flexion(walk.time_s, order) for order in range(3)]))
    columns = np.hstack(tables)
    curves = ca.interpolant("curves", "bspline", [walk.time_s.tolist()], columns.ravel().tolist(), {})

    # Scalar algebra as SX functions, called as one node each.
    now, x, wrench = ca.SX.sym("now", columns.shape[1]), ca.SX.sym("x", 6), ca.SX.sym("wrench", 6)
    ends = np.cumsum([0, *(table.shape[1] for table in tables)]).tolist()
    a, length, velocity, *arms, inverse_dynamics, held, reference = ca.vertsplit(now, ends)
    q, v, inertia, in_nmm = x[:3], x[3:], ca.DM(leg.inertia), ca.DM([1.0, 1e3, 1e3])
    pose = ca.vertcat(held[0], q[0], held[1], q[1], held[2], q[2])
    off, off_rate = q[2] - reference[0], v[2] - reference[1]
    active, passive, _ = rigid_tendon_forces(inverse.muscles, length - arms[2] * off, velocity - arms[2] * off_rate, ca)
    forces = a * active + passive
    pull = in_nmm * ca.vertcat(*(ca.dot(arm, forces) for arm in arms))
    push = -generalised_forces(pose, wrench)[MOVING]
    load = inertia * ca.vertcat(0.0, 0.0, reference[2]) - in_nmm * inverse_dynamics
    at_work = (pull, push, load, -ca.DM(leg.damping) * v)
    posed = ca.Function("posed", [now, x], [pose])
    powers = ca.vertcat(*(ca.dot(force, v) for force in at_work))
    moved = ca.Function("moved", [now, x, wrench], [ca.vertcat(v, (pull + push + load + at_work[3]) / inertia), powers])

    state, t = ca.MX.sym("x", 6), ca.MX.sym("t")
    given, contact = curves(t), wrench_function(model)
    rate, power = moved(given, state, contact(posed(given, state)))
    return MuscleDriven(
        rate=ca.Function("rate", [state, t], [rate]),
        powers=ca.Function("powers", [state, t], [power]),
        pose=ca.Function("pose", [state, t], [posed(given, state)]),
        start=np.concatenate([solved.poses[0, MOVING], [0.0, 0.0, float(flexion(walk.time_s[0], 1))]]),
    )


@dataclass(frozen=True)
class Motion:
    """At the walk's times (n,): states (n, 6), poses (n, 6), work since the start (n, 4) [N·mm] as in
    `MuscleDriven.powers`; steps and seconds of the integrator."""

    states: Array
    poses: Array
    work: Array
    steps: int
    seconds: float

    def energy_lost(self, leg: Leg) -> float:
        """Largest work that is not kinetic energy, over the largest work of the muscles."""
        kinetic = 0.5 * self.states[:, 3:] ** 2 @ np.array(leg.inertia)
        return float(np.abs(self.work.sum(axis=1) - (kinetic - kinetic[0])).max() / np.abs(self.work[:, 0]).max())


def simulate(driven: MuscleDriven, time_s: Array, tolerance: float = 1e-6) -> Motion:
    """Integrate over the walk; tolerance: relative and absolute [mm, rad, mm/s, rad/s]."""
    states, work, steps, seconds = integrated(driven.rate, driven.powers, driven.start, time_s, tolerance)
    poses = np.asarray(driven.pose.map(len(time_s))(states.T, time_s[None])).T
    return Motion(states, poses, work, steps, seconds)


def main(
    rotations: Path | None = None,
    inverse_dynamics: Path | None = None,
    muscles: Path | None = None,
    parameters: Path | None = None,
    surrogate: str = "knee",
    tolerance: float = 1e-4,
    out: Path = Path("results/muscle_driven"),
) -> None:
    """Solve a walk (four files, or the built-in one) for activations, which then drive the knee forward."""
    model = cc.load_surrogate(surrogate)
    inverse = MuscleContact(model, walk_of(rotations, inverse_dynamics, muscles, parameters))
    solved, walk, leg = inverse.solve(), inverse.walk, Leg()
    models: dict[str, ContactModel] = {"surrogate": model, "foundation": cc.foundation(model.scene)}
    print("contact     steps  seconds  medial, lateral off [% of peak]  flexion off [°]  energy lost [%]")
    motions, sides = {}, {}
    for name, contact in models.items():
        motions[name] = motion = simulate(build(contact, inverse, solved, leg), walk.time_s, tolerance)
        columns = [contact.load_names.index(side) for side in SIDES]
        sides[name] = contact(motion.poses)[:, columns]
        off = 100.0 * np.abs(sides[name] - solved.loads[:, :2]).max(axis=0) / np.abs(solved.loads[:, :2]).max(axis=0)
        flexion, lost = np.degrees(np.abs(motion.poses[:, 5] - walk.rz).max()), 100.0 * motion.energy_lost(leg)
        apart = f"{off[0]:.2f}, {off[1]:.2f}"
        print(f"{name:10s} {motion.steps:6d} {motion.seconds:8.3f} {apart:>32s} {flexion:16.2f} {lost:16.2g}")
    poses = motions["surrogate"].poses
    print(verify(model, poses, reference_model(model)).line)

    out.mkdir(parents=True, exist_ok=True)
    write_poses(walk.time_s, poses, out / "muscle_driven.csv")
    page = new_page(11.0, 4.0)
    axes = page.subplots(1, 3)
    for k, side in enumerate(("medial", "lateral")):
        axes[k].plot(walk.percent, -solved.loads[:, k], label="inverse", **TARGET)
        axes[k].plot(walk.percent, -sides["surrogate"][:, k], label="forward, surrogate", **SURROGATE)
        axes[k].plot(walk.percent, -sides["foundation"][:, k], label="forward, foundation", **FOUNDATION)
        axes[k].set_ylabel(f"{side} compression [N]")
    axes[2].plot(walk.percent, -np.degrees(walk.rz), label="walk", **TARGET)
    axes[2].plot(walk.percent, -np.degrees(poses[:, 5]), label="forward, surrogate", **SURROGATE)
    axes[2].set_ylabel("flexion [degrees]")
    axes[0].legend(fontsize=8)
    for axis in axes:
        axis.set_xlabel("cycle [%]")
    save_page(page, out / "muscle_driven.png")


if __name__ == "__main__":
    run_program(main)
