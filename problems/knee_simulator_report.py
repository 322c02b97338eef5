"""What the knee simulator says: times on surrogate and elastic foundation, balances, a CSV, a JSON and a picture."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import POSE_NAMES, POSE_UNITS, WRENCH_NAMES, Array, load_unit
from casadi_contact.files import replacing, writable_folder
from casadi_contact.machine import machine_record
from casadi_contact.structures import Surrogate
from problems.knee_simulator import KneeSimulator, Simulation, build, solve, start_state
from problems.simulator_balance import EnergyBalance, unbalanced

REFERENCE_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Run:
    """One model at one tolerance: median seconds per simulated second, and the largest difference off_mm, off_deg of
    its poses from the surrogate's motion at `REFERENCE_TOLERANCE`."""

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
    simulators: dict[str, KneeSimulator],
    tolerances: tuple[float, ...],
    *,
    integrator: str,
    cycles: float,
    repeats: int,
) -> list[Run]:
    """Run every simulator at every tolerance, all in turn, and compare with the first, the surrogate's."""
    first, *_ = simulators.values()
    start = start_state(first)
    seconds: dict[tuple[str, float], list[float]] = {}
    last: dict[tuple[str, float], Simulation] = {}
    for turn in range(repeats + 1):  # the first warms up
        for name, simulator in simulators.items():
            for tolerance in tolerances:
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


def report(
    surrogate: Surrogate,
    simulator: KneeSimulator,
    out: Path,
    *,
    tolerances: tuple[float, ...] = (1e-3, 1e-4, 1e-5),
    integrator: str = "cvodes",
    cycles: float = 1.0,
    repeats: int = 3,
) -> list[Run]:
    """Simulate on the surrogate and on two EF grids, print the tables, write CSV, JSON and picture in folder out."""
    writable_folder(out)
    scene = surrogate.scene
    nx, nz = scene.grids["fine"]
    foundations = [ElasticFoundation(scene, (nx, nz)), ElasticFoundation(scene, (2 * nx, 2 * nz))]
    simulators = {"surrogate": simulator}
    for foundation in foundations:
        label = f"EF {foundation.grid[0]}×{foundation.grid[1]}"
        simulators[label] = build(foundation, simulator.waveforms, simulator.rig)
    runs = race(simulators, tolerances, integrator=integrator, cycles=cycles, repeats=repeats)
    console = Console()
    console.print(_race_table(runs, integrator, repeats))
    start = start_state(simulator)
    motion = solve(simulator, start, cycles=cycles, integrator=integrator, tolerance=REFERENCE_TOLERANCE, energies=True)
    balance = EnergyBalance.of(simulator, motion)
    left = {name: unbalanced(motion, f) for name, f in zip(list(simulators)[1:], foundations, strict=True)}
    console.print(_balance_table(balance, left))
    summary = {
        "integrator": integrator,
        "cycles": cycles,
        "runs": [_run_record(run, runs) for run in runs],
        "energy_nmm": {
            "largest_turnover": float(np.abs(balance.applied + balance.drive).max()),
            "largest_error": float(np.abs(balance.error).max()),
            "largest_unstored": float(np.abs(balance.unstored).max()),
            "dissipated": float(balance.dissipation[-1]),
        },
        "unbalanced_rms": {
            name: dict(zip(WRENCH_NAMES, np.sqrt(np.mean(w**2, axis=0)).tolist(), strict=True))
            for name, w in left.items()
        },
        "machine": machine_record(),
    }
    with replacing(out / "knee_simulator.json") as beside:
        beside.write_text(json.dumps(summary, indent=1, ensure_ascii=False), "utf-8")
    _write_csv(out / "knee_simulator.csv", motion)
    finest = runs[-1]
    draw(simulator, motion, finest, balance, out / "knee_simulator.png")
    console.print(f"results in {out}", highlight=False)
    return runs


def _surrogate_run(run: Run, runs: list[Run]) -> Run:
    return next(other for other in runs if other.model == "surrogate" and other.tolerance == run.tolerance)


def _run_record(run: Run, runs: list[Run]) -> dict[str, Any]:
    return {
        "model": run.model,
        "tolerance": run.tolerance,
        "seconds_per_simulated_second": run.seconds_per_second,
        "ratio_to_surrogate": run.seconds_per_second / _surrogate_run(run, runs).seconds_per_second,
        "steps": run.simulation.steps,
        "evaluations": run.simulation.evaluations,
        "jacobians": run.simulation.jacobians,
        "off_mm": run.off_mm,
        "off_deg": run.off_deg,
    }


def _race_table(runs: list[Run], integrator: str, repeats: int) -> Table:
    table = Table(title=f"Knee simulator, {integrator}: medians of {repeats} runs in turn")
    for column in ("model", "tol", "steps", "rhs", "Jac", "ms/s", "ratio", "off mm", "off °"):
        table.add_column(column, justify="left" if column == "model" else "right", no_wrap=True)
    for run in runs:
        sim = run.simulation
        table.add_row(
            run.model,
            f"{run.tolerance:g}",
            str(sim.steps),
            str(sim.evaluations),
            str(sim.jacobians),
            f"{1e3 * run.seconds_per_second:.1f}",
            f"{run.seconds_per_second / _surrogate_run(run, runs).seconds_per_second:.1f}",
            f"{run.off_mm:.4f}",
            f"{run.off_deg:.4f}",
        )
    table.caption = (
        "ms per simulated second; ratio to the surrogate at the same tolerance; off: largest pose difference from the "
        f"surrogate's motion at a tolerance of {REFERENCE_TOLERANCE:g}"
    )
    return table


def _balance_table(balance: EnergyBalance, left: dict[str, Array]) -> Table:
    table = Table(title="Balances of the surrogate's motion")
    table.add_column("what")
    table.add_column("largest", justify="right")
    turnover = np.abs(balance.applied + balance.drive).max()
    table.add_row("energy brought in [N·mm]", f"{turnover:.4g}")
    table.add_row("energy not accounted for [N·mm]", f"{np.abs(balance.error).max():.2g}")
    table.add_row("work against contact not stored in it [N·mm]", f"{np.abs(balance.unstored).max():.2g}")
    for name, wrench in left.items():
        force, torque = np.abs(wrench[:, :3]).max(), np.abs(wrench[:, 3:]).max()
        table.add_row(f"unbalanced with loads of {name}: force [N], torque [N·mm]", f"{force:.2g}, {torque:.2g}")
    return table


def _write_csv(path: Path, motion: Simulation) -> None:
    header = ["frame", "time_s"]
    header += [f"{name}_{unit}" for name, unit in zip(POSE_NAMES, POSE_UNITS, strict=True)]
    header += [f"{name}_{load_unit(name).replace('·', '')}" for name in WRENCH_NAMES]
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for frame, row in enumerate(np.column_stack([motion.time_s, motion.poses, motion.wrenches])):
            writer.writerow([frame, *(f"{value:.9g}" for value in row)])


def draw(simulator: KneeSimulator, motion: Simulation, finest: Run, balance: EnergyBalance, path: Path) -> None:
    """Loads applied, the poses on surrogate and finest EF, and the energy balance, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 4)
    time_s, share = motion.time_s, motion.time_s / simulator.rig.period_s
    waves = simulator.waveforms
    axes[0, 0].plot(time_s, waves.axial_n.at(share), color="black", lw=4, alpha=0.25, label="applied")
    axes[0, 0].plot(time_s, -motion.wrenches[:, 1], color="#0072B2", label="contact")
    axes[0, 0].set_title("axial force [N]")
    axes[0, 0].legend(fontsize=8)
    axes[0, 1].plot(time_s, waves.ap_n.at(share), color="#0072B2", label="anterior-posterior force [N]")
    axes[0, 1].plot(time_s, waves.ie_nmm.at(share) / 100.0, color="#D55E00", label="torque [N·m × 10]")
    axes[0, 1].plot(time_s, waves.flexion_deg.at(share), color="#009E73", label="flexion [deg]")
    axes[0, 1].set_title("applied, prescribed")
    axes[0, 1].set_ylim(bottom=-420.0)
    axes[0, 1].legend(fontsize=8, loc="lower right")
    for axis, name in zip((axes[0, 2], axes[0, 3], *axes[1, :3]), POSE_NAMES[:5], strict=True):
        column = POSE_NAMES.index(name)
        turn = np.degrees if name.startswith("r") else np.asarray
        axis.plot(time_s, turn(motion.poses[:, column]), color="#0072B2", label="surrogate")
        axis.plot(time_s, turn(finest.simulation.poses[:, column]), color="#D55E00", ls="--", label=finest.model)
        axis.set_title(f"{name} [{'degrees' if name.startswith('r') else 'mm'}]")
    axes[0, 2].legend(fontsize=8)
    axis = axes[1, 3]
    for name, colour in (("springs", "#009E73"), ("dissipation", "#D55E00"), ("contact", "#0072B2")):
        axis.plot(time_s, getattr(balance, name), color=colour, label=name)
    axis.plot(time_s, balance.applied + balance.drive, color="black", lw=4, alpha=0.25, label="brought in")
    axis.plot(time_s, balance.stored, color="#CC79A7", ls="--", label="stored in contact")
    axis.set_title("energy since the start [N·mm]")
    axis.legend(fontsize=8)
    for axis in axes.ravel():
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.3)
    figure.suptitle("Load-driven knee simulator, one cycle")
    with replacing(path) as beside:
        figure.savefig(beside, dpi=76, format="png")
