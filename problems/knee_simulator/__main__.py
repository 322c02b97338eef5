"""The command ``python -m problems.knee_simulator``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.files import writable_folder
from casadi_contact.verification import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.knee_simulator.problem import LOAD_SCALE, build
from problems.knee_simulator.race import REFERENCE_TOLERANCE, race
from problems.knee_simulator.report import report
from problems.knee_simulator.solve import solve
from problems.knee_simulator.waveforms import WALKING

NAME = "knee_simulator"
app = new_app()


@app.command()
def run(
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    load_scale: Annotated[float, typer.Option(help="share of the loads of ISO 14243-1")] = LOAD_SCALE,
    integrator: Annotated[str, typer.Option(help="cvodes or idas, for surrogate and EF alike")] = "cvodes",
    cycles: Annotated[float, typer.Option(help="length of the simulation")] = 1.0,
    repeats: Annotated[int, typer.Option(min=1, help="timed runs of each model, in turn")] = 3,
    out: Annotated[Path, typer.Option(help="folder for knee_simulator.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Simulate a cycle on the surrogate and on the EF with the same integrator; compare times, poses and balances.

    Exit status 3: the contact model differs from the surrogate in some frames of the motion.
    """
    writable_folder(out)
    source = ContactSource.of(surrogate, scene)
    model = source.load()
    simulator = build(model, WALKING.with_loads_scaled(load_scale))
    runs = race(simulator, source.kind, integrator=integrator, cycles=cycles, repeats=repeats)
    motion = solve(simulator, cycles=cycles, integrator=integrator, tolerance=REFERENCE_TOLERANCE, energies=True)
    verdict = judge(model, motion.poses, np.ones(len(motion.poses), dtype=bool), own_model(model.scene))
    report(simulator, runs, motion, verdict, out)
    end_with(verdict, NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
