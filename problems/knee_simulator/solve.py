"""The motion of a knee simulator: its start at rest, and integration over a cycle."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.conventions import Array
from casadi_contact.interrupts import raise_if_interrupted
from casadi_contact.quantities import three_digits
from casadi_contact.transcription.functions import ContactFunctions
from problems import static_equilibrium
from problems.knee_simulator.problem import POWERS, KneeSimulator

INTEGRATORS = ("cvodes", "idas")


@dataclass(frozen=True)
class Simulation:
    """time_s (n,), states (n, 10), poses (n, 6), contact wrenches (n, 6); work (n, 4) since the start, as in `POWERS`
    [N·mm], empty if not asked for; steps, right-hand sides and Jacobians of the integrator; seconds of the integration
    alone; which integrator it was, and over how many cycles."""

    time_s: Array
    states: Array
    poses: Array
    wrenches: Array
    work: Array
    steps: int
    evaluations: int
    jacobians: int
    seconds: float
    integrator: str
    cycles: float


def start_state(simulator: KneeSimulator) -> Array:
    """State (10,) at rest in static equilibrium with the loads that a cycle begins with.

    Raises ValueError for a simulator on another model than a surrogate or foundation, and where no pose that it knows
    carries the loads.
    """
    model, rig = simulator.model, simulator.rig
    if not isinstance(model, ContactFunctions):
        raise ValueError(
            "a start is sought on a surrogate or foundation; pass that state to solve for any other contact model"
        )
    rest = np.array([*rig.rest_mm_rad, float(simulator.flexion_rz(0.0))])
    loads = np.asarray(simulator.applied(0.0)).T
    stiffness = np.append(rig.stiffness, 0.0)
    held = static_equilibrium.build(
        model, loads, free=static_equilibrium.FREE, rest=rest, stiffness=stiffness, about="moving"
    )
    result = static_equilibrium.solve(held)
    if not result.converged.all():
        raise ValueError(
            f"no equilibrium to start from: {result.reason[0]}; expected a joint that carries "
            f"{three_digits(-loads[0, 1])} N, {rig.axial_offset_mm:g} mm medially of the moving origin: take a scene "
            "with two sides like a knee's, smaller loads, a Rig with axial_offset_mm=0, or a start of your own"
        )
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
    if frames < 2 or not (0.0 < cycles < np.inf and 0.0 < tolerance < np.inf):
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
        raise_if_interrupted()
        said = next((line for line in reversed(str(error).splitlines()) if line.strip()), "no reason given")
        raise ValueError(
            f"{integrator} gave up, expected loads and poses that the joint carries: {said.strip()}"
        ) from None
    seconds = time.perf_counter() - began
    stats = function.stats()
    states = np.vstack([first, np.asarray(answer["xf"]).T])
    poses = simulator.poses(states, time_s)
    work = np.vstack([np.zeros(len(POWERS)), np.asarray(answer["qf"]).T]) if energies else np.empty((0, len(POWERS)))
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
        integrator=integrator,
        cycles=cycles,
    )
