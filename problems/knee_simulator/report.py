"""What the knee simulator says: times on surrogate and elastic foundation, balances, a CSV, a JSON and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.conventions import POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.files import writable_folder
from casadi_contact.motion.columns import write_columns
from casadi_contact.page import COLOURS, FOUNDATION, SURROGATE, WANTED, frame, new_page, panels, save_page
from casadi_contact.quantities import two_digits
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import Verdict
from problems.common.learned_range import reasons
from problems.common.outcome import print_reasons, print_verdict
from problems.common.records import DIGITS, load_columns, pose_columns, write_summary
from problems.knee_simulator.balance import EnergyBalance, unbalanced
from problems.knee_simulator.problem import KneeSimulator
from problems.knee_simulator.race import REFERENCE_TOLERANCE, Run, foundations
from problems.knee_simulator.solve import Simulation


def report(simulator: KneeSimulator, runs: list[Run], motion: Simulation, verdict: Verdict, out: Path) -> None:
    """Print the tables of a race and of a motion's balances, write CSV, JSON and picture in folder out.

    motion: the first model's, with energies; what its own loads leave unbalanced on two EF grids is measured here.
    """
    writable_folder(out)
    console = PlainConsole()
    print_verdict(console, verdict)
    console.print(_race_table(runs, motion.integrator))
    balance = EnergyBalance.of(simulator, motion)
    left = {foundation.label: unbalanced(motion, foundation) for foundation in foundations(simulator.model.scene)}
    console.print(_balance_table(balance, left, runs[0].model))
    reason = reasons(simulator.model, motion.poses, verdict)
    print_reasons(console, reason)
    summary = {
        "verdict": str(verdict),
        "integrator": motion.integrator,
        "cycles": motion.cycles,
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
    }
    write_summary(out / "knee_simulator.json", summary)
    _write_table(out / "knee_simulator.csv", motion, verdict, reason)
    draw(simulator, motion, runs, balance, out / "knee_simulator.png")
    console.print(f"results in {out}", highlight=False)


def _first_run(run: Run, runs: list[Run]) -> Run:
    return next(other for other in runs if other.model == runs[0].model and other.tolerance == run.tolerance)


def _run_record(run: Run, runs: list[Run]) -> dict[str, Any]:
    return {
        "model": run.model,
        "tolerance": run.tolerance,
        "seconds_per_simulated_second": run.seconds_per_second,
        f"ratio_to_{runs[0].model}": run.seconds_per_second / _first_run(run, runs).seconds_per_second,
        "steps": run.simulation.steps,
        "evaluations": run.simulation.evaluations,
        "jacobians": run.simulation.jacobians,
        "off_mm": run.off_mm,
        "off_deg": run.off_deg,
    }


def _race_table(runs: list[Run], integrator: str) -> Table:
    table = Table(title=f"Knee simulator, {integrator}: medians of runs in turn")
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
            f"{run.seconds_per_second / _first_run(run, runs).seconds_per_second:.1f}",
            f"{run.off_mm:.4f}",
            f"{run.off_deg:.4f}",
        )
    table.caption = (
        f"ms per simulated second; ratio to the {runs[0].model} at the same tolerance; off: largest pose difference "
        f"from its motion at a tolerance of {REFERENCE_TOLERANCE:g}"
    )
    return table


def _balance_table(balance: EnergyBalance, left: dict[str, Array], kind: str) -> Table:
    table = Table(title=f"Balances of the {kind}'s motion")
    table.add_column("what")
    table.add_column("largest", justify="right")
    turnover = np.abs(balance.applied + balance.drive).max()
    table.add_row("energy brought in [N·mm]", f"{turnover:.4g}")
    table.add_row("energy not accounted for [N·mm]", f"{np.abs(balance.error).max():.2g}")
    table.add_row("work against contact not stored in it [N·mm]", f"{np.abs(balance.unstored).max():.2g}")
    for name, wrench in left.items():
        force, torque = np.abs(wrench[:, :3]).max(), np.abs(wrench[:, 3:]).max()
        table.add_row(
            f"unbalanced with loads of {name}: force [N], torque [N·mm]", f"{two_digits(force)}, {two_digits(torque)}"
        )
    return table


def _write_table(path: Path, motion: Simulation, verdict: Verdict, reason: np.ndarray) -> None:
    columns: dict[str, Any] = {"frame": range(len(motion.time_s)), "time_s": motion.time_s}
    columns |= pose_columns(motion.poses) | load_columns(WRENCH_NAMES, motion.wrenches)
    write_columns(path, {**columns, "reason": reason, "verdict": verdict.words}, digits=DIGITS)


def draw(simulator: KneeSimulator, motion: Simulation, runs: list[Run], balance: EnergyBalance, path: Path) -> None:
    """Loads applied, the poses on surrogate and finest EF, and the energy balance, as a PNG."""
    kind, finest = runs[0].model, runs[-1]
    page = new_page(14.0, 8.5)
    moved = ((0, 2), (0, 3), (1, 0), (1, 1), (1, 2))
    compared = finest.model != kind  # an EF ran as well
    parts = panels(page, 2, 4, moved if compared else ())
    axes = {place: panel.curves for place, panel in parts.items()}
    time_s, share = motion.time_s, motion.time_s / simulator.rig.period_s
    waves = simulator.waveforms
    axes[0, 0].plot(time_s, waves.axial_n.at(share), label="applied", **WANTED)
    axes[0, 0].plot(time_s, -motion.wrenches[:, 1], label="contact", **SURROGATE)
    axes[0, 0].set_ylabel("axial force [N]")
    axes[0, 0].legend(fontsize=8)
    axes[0, 1].plot(time_s, waves.ap_n.at(share), color=COLOURS["blue"], label="anterior-posterior force [N]")
    axes[0, 1].plot(time_s, waves.ie_nmm.at(share) / 100.0, color=COLOURS["vermillion"], label="torque [N·m × 10]")
    axes[0, 1].plot(time_s, waves.flexion_deg.at(share), color=COLOURS["green"], label="flexion [deg]")
    axes[0, 1].set(title="applied, prescribed", ylabel="[N], [N·m × 10], [degrees]")
    axes[0, 1].set_ylim(bottom=-420.0)
    axes[0, 1].legend(fontsize=8, loc="lower right")
    for place, name in zip(moved, POSE_NAMES[:5], strict=True):
        column, unit = POSE_NAMES.index(name), "degrees" if name.startswith("r") else "mm"
        turn = np.degrees if name.startswith("r") else np.asarray
        own, other = turn(motion.poses[:, column]), turn(finest.simulation.poses[:, column])
        axes[place].plot(time_s, own, label=kind, **SURROGATE)
        axes[place].set_ylabel(f"{name} [{unit}]")
        if not compared:
            continue
        axes[place].plot(time_s, other, label=finest.model, **FOUNDATION)
        parts[place].difference(time_s, other - own, f"EF - {kind}", **FOUNDATION)
        parts[place].differences.set_ylabel(f"EF off [{unit}]", fontsize=7)
    axes[0, 2].legend(fontsize=8)
    axis = axes[1, 3]
    for name, colour in (
        ("springs", COLOURS["green"]),
        ("dissipation", COLOURS["vermillion"]),
        ("contact", COLOURS["blue"]),
    ):
        axis.plot(time_s, getattr(balance, name), color=colour, label=name)
    axis.plot(time_s, balance.applied + balance.drive, label="brought in", **WANTED)
    axis.plot(time_s, balance.stored, color=COLOURS["purple"], ls="--", label="stored in contact")
    axis.set_ylabel("energy since the start [N·mm]")
    axis.legend(fontsize=8)
    frame((panel.lowest for panel in parts.values()), "time [s]")
    length = "one cycle" if motion.cycles == 1.0 else f"{motion.cycles:g} cycles"
    page.suptitle(f"Load-driven knee simulator, {length}")
    save_page(page, path, dots_per_inch=76)
