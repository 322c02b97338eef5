"""The motion of a muscle-driven knee over its walk, by CVODES with the exact Jacobian."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.interrupts import raise_if_interrupted
from problems.muscle_driven.problem import POWERS, MuscleDriven

LARGEST_ENERGY_LOST = 1e-3  # of the muscles' work: beyond it a motion is the integrator's, not the muscles'
FARTHEST_DEG = 5.0  # from the walk's flexion: beyond it curves between frames are not those of the walk; usual is 0.5


@dataclass(frozen=True)
class Simulation:
    """At the walk's times (n,): states (n, 6), poses (n, 6), contact wrenches on the insert (n, 6), work since the
    start (n, 4) as in `POWERS` [N·mm]; steps of the integrator, seconds of the integration alone."""

    time_s: Array
    states: Array
    poses: Array
    wrenches: Array
    work: Array
    kinetic: Array
    steps: int
    jacobians: int
    seconds: float

    @property
    def energy_error(self) -> Array:
        """Work that is neither kinetic energy nor lost, (n,) [N·mm]: the integrator's error."""
        return np.asarray(self.work.sum(axis=1) - (self.kinetic - self.kinetic[0]))

    @property
    def energy_lost(self) -> float:
        """The largest energy that the integrator lost or made over the largest work of the muscles."""
        muscles = self.work[:, POWERS.index("muscles")]
        return float(np.abs(self.energy_error).max() / np.abs(muscles).max())


def solve(driven: MuscleDriven, *, tolerance: float = 1e-6) -> Simulation:
    """Integrate over the walk. tolerance: relative and absolute, per step [mm, rad, mm/s, rad/s].

    Raises ValueError for a tolerance that is not positive, and where the integrator gives up.
    """
    if not 0.0 < tolerance < np.inf:
        raise ValueError(f"tolerance is {tolerance}, expected a positive number")
    first, time_s = driven.start(), driven.time_s
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100_000}
    integrate = ca.integrator("walk", "cvodes", driven.dae(), float(time_s[0]), time_s[1:].tolist(), options)
    began = time.perf_counter()
    try:
        answer = integrate(x0=first)
    except RuntimeError as error:
        raise_if_interrupted()
        said = next((line for line in reversed(str(error).splitlines()) if line.strip()), "no reason given")
        raise ValueError(f"cvodes gave up, expected muscles that hold the knee: {said.strip()}") from None
    seconds = time.perf_counter() - began
    states = np.vstack([first, np.asarray(answer["xf"]).T])
    poses = np.asarray(driven.pose.map(len(time_s))(states.T, time_s[None])).T
    stats = integrate.stats()
    return Simulation(
        time_s=time_s,
        states=states,
        poses=poses,
        wrenches=np.asarray(driven.contact.map(len(time_s))(poses.T)).T,
        work=np.vstack([np.zeros(len(POWERS)), np.asarray(answer["qf"]).T]),
        kinetic=0.5 * states[:, 3:] ** 2 @ driven.leg.inertia,
        steps=int(stats["nsteps"]),
        jacobians=int(stats["n_call_jacF"]),
        seconds=seconds,
    )
