"""A load-driven knee simulator: forward simulation of a cycle in the manner of ISO 14243-1.

Flexion rz(t) is prescribed; axial force, anterior-posterior force and internal-external torque are applied at the
moving origin, the axial force `axial_offset_mm` medially of it; linear springs stand for the soft tissue
(anterior-posterior and internal-external); adduction rx and medial-lateral tz are free. With q = (tx, ty, tz, rx, ry)

    M·q̈ = Q(q; applied(t)) - Q(q; W(q)) - k·(q - q_rest) - c·q̇

(Q as in `problems.joint_mechanics`, W the contact wrench on the insert, M, k, c diagonal and stated in `Rig`). The
state (q, q̇), 10 numbers, is integrated by CVODES (BDF, Newton with the exact Jacobian of the whole right-hand side) or
IDAS; the same equations take a surrogate or any other contact model, so that both are timed on the same integrator.

The energy balance reads, with every power integrated along with the state,

    work of applied loads + work of the flexion drive = Δkinetic + Δsprings + dissipation + work against contact

and the work against contact is compared with the change of the contact's stored energy (`lifting_energy`).

Run ``python -m problems.knee_simulator --help``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array, pose_index
from casadi_contact.files import writable_folder
from casadi_contact.structures import Surrogate, load_surrogate
from problems import static_equilibrium
from problems.command import run_command
from problems.joint_mechanics import generalised_forces, wrench_function
from problems.simulator_rig import Rig
from problems.simulator_waveforms import WALKING, Waveforms
from problems.static_equilibrium import FREE

INTEGRATORS = ("cvodes", "idas")
POWERS = ("applied", "drive", "dissipation", "contact")
LOAD_SCALE = 0.8  # of ISO 14243-1: 2600 N would load the lateral side beyond what the surrogate `knee` has learned
_RZ = pose_index("rz")


@dataclass(frozen=True)
class KneeSimulator:
    """Equations that can be looked at unsolved: dae for casadi.integrator, with the powers as quadratures by choice.

    rate: (state (10), t) -> d state/dt; powers: (state, t) -> `POWERS` [N·mm/s]; applied: t -> applied wrench about the
    moving origin (6); contact: pose -> wrench on the insert (6), kept here because callbacks must live.
    """

    model: ContactModel | Surrogate
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


@dataclass(frozen=True)
class Simulation:
    """time_s (n,), states (n, 10), poses (n, 6), contact wrenches (n, 6); work (n, 4) since the start, as in `POWERS`
    [N·mm], empty if not asked for; steps and right-hand sides of the integrator; seconds of the integration alone."""

    time_s: Array
    states: Array
    poses: Array
    wrenches: Array
    work: Array
    steps: int
    evaluations: int
    jacobians: int
    seconds: float
    settings: dict[str, Any] = field(default_factory=dict)


def build(model: ContactModel | Surrogate, waveforms: Waveforms | None = None, rig: Rig | None = None) -> KneeSimulator:
    """Equations of motion on a surrogate or any contact model; waveforms: WALKING at `LOAD_SCALE` if left out."""
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


def start_state(simulator: KneeSimulator, time_s: float = 0.0) -> Array:
    """State (10,) at rest in static equilibrium with the loads at a time; needs a simulator on a surrogate.

    Raises ValueError where no pose in the learned range carries the loads.
    """
    model, rig = simulator.model, simulator.rig
    if not isinstance(model, Surrogate):
        raise ValueError("a start is sought on a surrogate; pass that state to solve for any other contact model")
    rest = np.array([*rig.rest_mm_rad, float(simulator.flexion_rz(time_s))])
    loads = np.asarray(simulator.applied(time_s)).T
    result = static_equilibrium.solve(
        static_equilibrium.build(
            model, loads, free=FREE, rest=rest, stiffness=np.append(rig.stiffness, 0.0), about="moving"
        )
    )
    if not result.converged.all():
        raise ValueError(f"no equilibrium to start from at {time_s:g} s: {result.reason[0]}")
    return np.concatenate([result.poses[0, :5], np.zeros(5)])


def solve(
    simulator: KneeSimulator,
    start: ArrayLike | None = None,
    *,
    cycles: float = 1.0,
    frames: int = 101,
    integrator: str = "cvodes",
    tolerance: float = 1e-6,
    energies: bool = False,
) -> Simulation:
    """Integrate from a start state (10,), `start_state` if left out, over a number of cycles, reported at equal frames.

    tolerance: relative and absolute, per step [mm, rad, mm/s, rad/s]. Raises ValueError for an unknown integrator,
    a wrong start, or where the integrator gives up.
    """
    if integrator not in INTEGRATORS:
        raise ValueError(f"integrator is {integrator!r}, expected one of {', '.join(INTEGRATORS)}")
    if frames < 2 or not cycles > 0.0 or not tolerance > 0.0:
        raise ValueError(f"frames {frames}, cycles {cycles}, tolerance {tolerance}: expected >= 2 and positive numbers")
    first = start_state(simulator) if start is None else np.asarray(start, dtype=float)
    if first.shape != (10,) or not np.isfinite(first).all():
        raise ValueError(f"start has shape {first.shape}, expected 10 finite numbers: pose without rz, then its rates")
    time_s = np.linspace(0.0, cycles * simulator.rig.period_s, frames)
    options: dict[str, Any] = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100_000}
    dae = simulator.dae(energies=energies)
    function = ca.integrator("simulate", integrator, dae, 0.0, time_s[1:].tolist(), options)
    began = time.perf_counter()
    try:
        answer = function(x0=first)
    except RuntimeError as error:
        said = next((line for line in reversed(str(error).splitlines()) if line.strip()), "no reason given")
        raise ValueError(
            f"{integrator} gave up, expected loads and poses that the joint carries: {said.strip()}"
        ) from None
    seconds = time.perf_counter() - began
    stats = function.stats()
    states = np.vstack([first, np.asarray(answer["xf"]).T])
    poses = simulator.poses(states, time_s)
    work = np.vstack([np.zeros(4), np.asarray(answer["qf"]).T]) if energies else np.empty((0, 4))
    return Simulation(
        time_s=time_s,
        states=states,
        poses=poses,
        wrenches=np.asarray(simulator.contact.map(len(poses))(poses.T)).T,
        work=work,
        steps=int(stats["nsteps"]),
        evaluations=int(stats["n_call_daeF"]),
        jacobians=int(stats["n_call_jacF"]),
        seconds=seconds,
        settings={"integrator": integrator, "tolerance": tolerance, "cycles": cycles},
    )


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    load_scale: Annotated[float, typer.Option(help="share of the loads of ISO 14243-1")] = LOAD_SCALE,
    integrator: Annotated[str, typer.Option(help="cvodes or idas, for surrogate and EF alike")] = "cvodes",
    cycles: Annotated[float, typer.Option(help="length of the simulation")] = 1.0,
    repeats: Annotated[int, typer.Option(min=1, help="timed runs of each model, in turn")] = 3,
    out: Annotated[Path, typer.Option(help="folder for knee_simulator.csv, .png, .json")] = Path("results"),
) -> None:
    """Simulate a cycle on the surrogate and on the EF with the same integrator; compare times, poses and balances."""
    from problems.knee_simulator_report import report  # draws with matplotlib: not needed to solve

    writable_folder(out)
    model = load_surrogate(surrogate)
    simulator = build(model, WALKING.with_loads_scaled(load_scale))
    report(model, simulator, out, integrator=integrator, cycles=cycles, repeats=repeats)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, "knee_simulator")


if __name__ == "__main__":
    main()
