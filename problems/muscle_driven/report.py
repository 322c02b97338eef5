"""Forward beside inverse: a table of times and differences, every frame as CSV, a JSON summary and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.core.conventions import WRENCH_NAMES, Array
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import COLOURS, FOUNDATION, SURROGATE, WANTED, frame, new_page, panels, save_page
from casadi_contact.scenes.columns import write_columns
from problems.common.outcome import print_verdict
from problems.common.records import DIGITS, load_columns, pose_columns, write_summary
from problems.muscle_driven.problem import POWERS, MuscleDriven
from problems.muscle_driven.solve import Simulation

_STYLES: tuple[dict[str, Any], ...] = (SURROGATE, FOUNDATION, {"color": COLOURS["green"], "linestyle": ":"})


@dataclass(frozen=True)
class Run:
    """One contact model's simulation, loads (n, 2) of `SIDES` there [N], and median seconds of a cycle."""

    simulation: Simulation
    sides: Array
    seconds: float

    @classmethod
    def of(cls, driven: MuscleDriven, simulation: Simulation, seconds: float) -> Run:
        """Evaluate both sides at the simulated poses."""
        columns = [driven.model.load_names.index(name) for name in SIDES]
        return cls(simulation, driven.model(simulation.poses)[:, columns], seconds)


def differences(driven: MuscleDriven, run: Run) -> dict[str, float]:
    """Forward less inverse, the largest of the cycle: loads in % of their peak, flexion in degrees; and the largest
    energy that the integrator lost or made, in % of the muscles' work."""
    solved = driven.solved
    wanted = solved.loads[:, : len(SIDES)]
    share = 100.0 * np.abs(run.sides - wanted).max(axis=0) / np.abs(wanted).max(axis=0)
    flexion = np.degrees(np.abs(run.simulation.poses[:, 5] - driven.inverse.walk.rz).max())
    named = {f"{name}_percent_of_peak": float(value) for name, value in zip(SIDES, share, strict=True)}
    return {**named, "flexion_deg": float(flexion), "energy_percent": 100.0 * run.simulation.energy_lost}


def report(
    driven: Mapping[str, MuscleDriven], runs: Mapping[str, Run], verdict: Verdict, out: Path, reason: str = ""
) -> None:
    """Print the table; write muscle_driven.csv, .png and summary.json in the folder out. The first model is drawn.

    verdict: on the first model's motion; reason: why motions are not those of the walk, "" where all are.
    """
    found = {name: differences(driven[name], run) for name, run in runs.items()}
    first, slowest = next(iter(runs)), max(run.seconds for run in runs.values())
    title = f"Muscle-driven forward simulation, {driven[first].inverse.walk.name}: largest difference from inverse"
    table = Table(title=title)
    for column in (
        "contact",
        "s a cycle",
        "times faster",
        "steps",
        "medial [%]",
        "lateral [%]",
        "flexion [°]",
        "energy [%]",
    ):
        table.add_column(column, justify="right", no_wrap=column == "contact")
    for name, run in runs.items():
        cells = [f"{value:.2g}" for value in found[name].values()]
        table.add_row(name, f"{run.seconds:.3g}", f"{slowest / run.seconds:.1f}", str(run.simulation.steps), *cells)
    console = PlainConsole()
    print_verdict(console, verdict)
    console.print(table)
    simulation, walk = runs[first].simulation, driven[first].inverse.walk
    columns: dict[str, Any] = {"time_s": walk.time_s, "cycle_percent": walk.percent, **pose_columns(simulation.poses)}
    columns |= load_columns(WRENCH_NAMES, simulation.wrenches)
    columns |= {f"{name}_N": curve for name, curve in zip(SIDES, runs[first].sides.T, strict=True)}
    columns |= {f"work_{name}_Nmm": curve for name, curve in zip(POWERS, simulation.work.T, strict=True)}
    columns |= {"kinetic_Nmm": simulation.kinetic, "verdict": verdict.words}
    write_columns(out / "muscle_driven.csv", columns, digits=DIGITS)
    summary = {
        name: {**found[name], "seconds": run.seconds, "steps": run.simulation.steps} for name, run in runs.items()
    }
    said = {"verdict": str(verdict), "reason": reason, "walk": walk.name, "models": summary}
    write_summary(out / "summary.json", said)
    draw(driven, runs, out / "muscle_driven.png", "not solved" if reason else "")
    console.print(f"results in {out}", highlight=False)


def draw(driven: Mapping[str, MuscleDriven], runs: Mapping[str, Run], path: Path, remark: str = "") -> None:
    """Compression of both sides and flexion, forward and inverse, and where the energy went, as a PNG; remark: what its
    title says besides."""
    page = new_page(13.0, 8.5)
    parts = panels(page, 2, 2, set())
    first = next(iter(runs))
    walk, solved, simulation = driven[first].inverse.walk, driven[first].solved, runs[first].simulation
    for column, side in enumerate(("medial", "lateral")):
        axis = parts[0, column].curves
        axis.plot(walk.percent, -solved.loads[:, column], label="inverse", **WANTED)
        for (name, run), style in zip(runs.items(), _STYLES, strict=False):
            axis.plot(walk.percent, -run.sides[:, column], label=f"forward, {name}", **style)
        axis.set(title=f"{side} side", ylabel="compression [N]")
        axis.legend(fontsize=8)
    flexion = parts[1, 0].curves
    flexion.plot(walk.percent, -np.degrees(walk.rz), label="walk", **WANTED)
    flexion.plot(walk.percent, -np.degrees(simulation.poses[:, 5]), label=f"forward, {first}", **SURROGATE)
    flexion.set(title="flexion", ylabel="[degrees]")
    flexion.legend(fontsize=8)
    energy = parts[1, 1].curves
    colours = [COLOURS[name] for name in ("blue", "vermillion", "green", "purple")]
    for name, curve, color in zip(POWERS, simulation.work.T, colours, strict=True):
        energy.plot(walk.percent, 1e-3 * curve, color=color, label=f"work of {name}")
    gained = 1e-3 * (simulation.kinetic - simulation.kinetic[0])
    energy.plot(walk.percent, gained, label="change of kinetic energy", **WANTED)
    energy.set(title="energy", ylabel="[J]")
    energy.legend(fontsize=8)
    frame((panel.lowest for panel in parts.values()), "cycle [%]")
    page.suptitle(f"Muscles drive the knee: {', '.join(filter(None, [walk.name, remark]))}")
    save_page(page, path, dots_per_inch=110)
