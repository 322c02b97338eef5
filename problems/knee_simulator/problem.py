"""A load-driven knee simulator: forward simulation of a cycle in the manner of ISO 14243-1.

Flexion rz(t) is prescribed; axial force, anterior-posterior force and internal-external torque are applied at the
moving origin, the axial force `axial_offset_mm` medially of it; linear springs stand for the soft tissue
(anterior-posterior and internal-external); adduction rx and medial-lateral tz are free. With q = (tx, ty, tz, rx, ry)

    M·q̈ = Q(q; applied(t)) - Q(q; W(q)) - k·(q - q_rest) - c·q̇

(Q as in `generalised_forces`, W the contact wrench on the insert, M, k, c diagonal and stated in `Rig`). The
state (q, q̇), 10 numbers, is integrated by CVODES (BDF, Newton with the exact Jacobian of the whole right-hand side) or
IDAS; the same equations take a surrogate or any other contact model, so that both are timed on the same integrator.

The energy balance reads, with every power integrated along with the state,

    work of applied loads + work of the flexion drive = Δkinetic + Δsprings + dissipation + work against contact

and the work against contact is compared with the change of the contact's stored energy (`lifting_energy`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array, pose_index
from casadi_contact.optimisation import generalised_forces, wrench_function
from casadi_contact.scenes import Scene
from problems.knee_simulator.rig import Rig
from problems.knee_simulator.waveforms import WALKING, Waveforms

LOAD_SCALE = 0.8  # of ISO 14243-1: 2600 N would load the lateral side beyond what the surrogate `knee` has learned
POWERS = ("applied", "drive", "dissipation", "contact")
DOWN = {"-Fy"}  # how a knee's patches are pressed
_RZ = pose_index("rz")


@dataclass(frozen=True)
class KneeSimulator:
    """Equations that can be looked at unsolved: dae for casadi.integrator, with the powers as quadratures by choice.

    rate: (state (10), t) -> d state/dt; powers: (state, t) -> `POWERS` [N·mm/s]; applied: t -> applied wrench about the
    moving origin (6); contact: pose -> wrench on the insert (6).
    """

    model: ContactModel
    waveforms: Waveforms
    rig: Rig
    contact: ca.Function
    rate: ca.Function
    powers: ca.Function
    applied: ca.Function

    def dae(self, *, energies: bool = False) -> dict[str, Any]:
        """x, t, ode (and quad) for casadi.integrator."""
        x, t = ca.MX.sym("x", 10), ca.MX.sym("t")
        problem: dict[str, Any] = {"x": x, "t": t, "ode": self.rate(x, t)}
        if energies:
            problem["quad"] = self.powers(x, t)
        return problem

    def flexion_rz(self, time_s: ArrayLike) -> Array:
        """Prescribed rz (n,) [rad]."""
        share = np.asarray(time_s, dtype=float) / self.rig.period_s
        return -np.radians(np.asarray(self.waveforms.flexion_deg.at(share)))

    def poses(self, states: Array, time_s: Array) -> Array:
        """Poses (n, 6) of states (n, 10)."""
        return np.column_stack([states[:, :5], self.flexion_rz(time_s)])


def pressed_along(scene: Scene) -> set[str]:
    """What presses the patches of a scene, such as -Fy; |F| where there is no single direction."""
    return {f"{'+' if n.sign > 0.0 else '-'}{n.component}" if n.component else "|F|" for n in scene.normal_loads}


def build(model: ContactModel, waveforms: Waveforms | None = None, rig: Rig | None = None) -> KneeSimulator:
    """Equations of motion on a surrogate or any contact model; waveforms: WALKING at `LOAD_SCALE` if left out.

    Raises ValueError for a scene whose patches are not all pressed from above, as those of a knee are, or which locks
    or ties pose parameters.
    """
    model.scene.pose_space.check_whole("a knee simulator")
    pressed = pressed_along(model.scene)
    if pressed != DOWN:
        raise ValueError(
            f"a knee simulator presses the moving body down, along -Fy; scene {model.scene.name} is pressed along "
            f"{', '.join(sorted(pressed))}: pose estimation, settling and optimal control take it"
        )
    waveforms = WALKING.with_loads_scaled(LOAD_SCALE) if waveforms is None else waveforms
    rig = Rig() if rig is None else rig
    contact = wrench_function(model)
    # Everything but contact is scalar algebra: SX functions, called as one node each.
    q, v, t = ca.SX.sym("q", 5), ca.SX.sym("v", 5), ca.SX.sym("t")
    pose, wrench = ca.SX.sym("pose", 6), ca.SX.sym("wrench", 6)
    share = t / rig.period_s
    rz = -np.pi / 180.0 * waveforms.flexion_deg.at(share)
    axial = waveforms.axial_n.at(share)
    given = ca.vertcat(waveforms.ap_n.at(share), -axial, 0, rig.axial_offset_mm * axial, waveforms.ie_nmm.at(share), 0)
    by_given = generalised_forces(pose, given, about="moving")
    by_contact = -generalised_forces(pose, wrench)
    forces = (by_given + by_contact)[:5] - ca.DM(rig.stiffness) * (pose[:5] - ca.DM(rig.rest_mm_rad))
    acceleration = (forces - ca.DM(rig.damping) * v) / ca.DM(rig.inertia)
    speed = ca.vertcat(v, ca.jacobian(rz, t))
    flexing = speed[_RZ]
    powers = ca.vertcat(
        ca.dot(by_given, speed),
        -(by_given + by_contact)[_RZ] * flexing,
        ca.dot(v, ca.DM(rig.damping) * v),
        -ca.dot(by_contact, speed),
    )
    pose_of = ca.Function("pose", [q, t], [ca.vertcat(q, rz)])
    rate_of = ca.Function("motion", [pose, v, t, wrench], [ca.vertcat(v, acceleration)])
    powers_of = ca.Function("power", [pose, v, t, wrench], [powers])
    x, at = ca.MX.sym("x", 10), ca.MX.sym("t")
    posed = pose_of(x[:5], at)
    touching = contact(posed)
    return KneeSimulator(
        model=model,
        waveforms=waveforms,
        rig=rig,
        contact=contact,
        rate=ca.Function("rate", [x, at], [rate_of(posed, x[5:], at, touching)]),
        powers=ca.Function("powers", [x, at], [powers_of(posed, x[5:], at, touching)]),
        applied=ca.Function("applied", [t], [given]),
    )
