"""The same motion on a contact model and on elastic foundations, timed on the same integrator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track

from casadi_contact.contact import ElasticFoundation
from casadi_contact.scenes import Scene
from casadi_contact.verification import own_model
from problems.knee_simulator.problem import KneeSimulator, build
from problems.knee_simulator.solve import Simulation, solve, start_state

TOLERANCES, REFERENCE_TOLERANCE = (1e-3, 1e-4, 1e-5), 1e-8


@dataclass(frozen=True)
class Run:
    """One model at one tolerance: median seconds per simulated second, and the largest difference off_mm, off_deg of
    its poses from the first model's motion at `REFERENCE_TOLERANCE`."""

    model: str
    tolerance: float
    simulation: Simulation
    seconds_per_second: float
    off_mm: float
    off_deg: float


def pose_difference(a: Simulation, b: Simulation) -> tuple[float, float]:
    """Largest difference of two motions over all frames: [mm], [degrees]."""
    off = np.abs(a.poses - b.poses)
    return float(off[:, :3].max()), float(np.degrees(off[:, 3:].max()))


def race(
    first: KneeSimulator,
    kind: str = "surrogate",
    *,
    integrator: str = "cvodes",
    cycles: float = 1.0,
    repeats: int = 3,
) -> list[Run]:
    """Run a simulator, whose model tables call by its kind, and those of two EF grids at every one of `TOLERANCES`, all
    in turn, and compare with it."""
    simulators = {kind: first}
    for foundation in foundations(first.model.scene):
        simulators[foundation.label] = build(foundation, first.waveforms, first.rig)
    start = start_state(first)
    seconds: dict[tuple[str, float], list[float]] = {}
    last: dict[tuple[str, float], Simulation] = {}
    for turn in track(range(repeats + 1), "race", console=Console(stderr=True), transient=True):  # the first warms up
        for name, simulator in simulators.items():
            for tolerance in TOLERANCES:
                last[name, tolerance] = solve(
                    simulator, start, cycles=cycles, integrator=integrator, tolerance=tolerance
                )
                if turn:
                    seconds.setdefault((name, tolerance), []).append(last[name, tolerance].seconds)
    duration = cycles * first.rig.period_s
    exact = solve(first, start, cycles=cycles, integrator=integrator, tolerance=REFERENCE_TOLERANCE)
    return [
        Run(
            name,
            tolerance,
            simulation,
            float(np.median(seconds[name, tolerance])) / duration,
            *pose_difference(simulation, exact),
        )
        for (name, tolerance), simulation in last.items()
    ]


def foundations(scene: Scene) -> list[ElasticFoundation]:
    """The scene's EF on its fine grid, and on one twice as fine each way; none where there is no EF at hand."""
    if not isinstance(own_model(scene), ElasticFoundation):
        return []
    nx, nz = scene.grids["fine"]
    return [ElasticFoundation(scene, (nx, nz)), ElasticFoundation(scene, (2 * nx, 2 * nz))]
