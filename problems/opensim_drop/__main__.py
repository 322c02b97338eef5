"""The command ``python -m problems.opensim_drop``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.core.files.writing import writable_folder
from casadi_contact.optimisation.verification.verdict import judge, own_model
from casadi_contact.surrogate.load import load_surrogate
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.opensim_drop.compare import compare
from problems.opensim_drop.problem import Drop
from problems.opensim_drop.report import report

NAME = "opensim_drop"
app = new_app()


@app.command()
def run(
    surrogate: Annotated[str, typer.Option(help="a ready surrogate (knee) or the path of a .h5 file")] = "knee",
    lift_mm: Annotated[float, typer.Option(help="height of the start over a learned pose [mm]")] = 0.3,
    push_n: Annotated[float, typer.Option(help="force that presses, along -y [N]")] = 400.0,
    mass_kg: Annotated[float, typer.Option(help="mass of the falling body [kg]")] = 1.0,
    duration_s: Annotated[float, typer.Option(help="length of the simulation [s]")] = 0.05,
    out: Annotated[Path, typer.Option(help="folder for opensim_drop.csv, .json and .png")] = RESULTS / NAME,
) -> None:
    """Let a component fall onto the other by OpenSim and by CasADi, on the same exported kernel.

    Exit status 3: on some poses of the fall the contact model differs from the surrogate.
    """
    writable_folder(out)
    drop = Drop(
        load_surrogate(surrogate),
        lift_mm=lift_mm,
        push_n=(0.0, -push_n, 0.0),
        mass_kg=mass_kg,
        duration_s=duration_s,
    )
    compared = compare(drop)
    poses = compared.casadi
    verdict = judge(drop.surrogate, poses, np.ones(len(poses), dtype=bool), own_model(drop.surrogate.scene))
    report(drop, compared, verdict, out)
    end_with(verdict, NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
