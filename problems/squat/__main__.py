"""The command ``python -m problems.squat``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.files import writable_folder
from casadi_contact.terminal import numbers
from casadi_contact.verification import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource
from problems.squat.leg import Body
from problems.squat.problem import build
from problems.squat.report import report
from problems.squat.solve import trade_off

NAME = "squat"
app = new_app()


@app.command()
def run(
    scene: Annotated[str, typer.Option(help="ready scene or scene .toml of a knee, whose foundation is used")] = "knee",
    weights: Annotated[
        str, typer.Option(help="of the squared medial force in body weights, separated by commas")
    ] = "0,0.001,0.003,0.01,0.03,0.1,0.3,1",
    depth: Annotated[float, typer.Option(help="deepest knee flexion [deg]")] = 80.0,
    duration: Annotated[float, typer.Option(help="of the squat [s]")] = 3.0,
    intervals: Annotated[int, typer.Option(help="collocation intervals")] = 24,
    mass: Annotated[float, typer.Option(help="of the body [kg]")] = 75.0,
    height: Annotated[float, typer.Option(help="of the body [m]")] = 1.75,
    lever: Annotated[float, typer.Option(help="how far medially of the knee the ground force passes [mm]")] = 20.0,
    out: Annotated[Path, typer.Option(help="folder for squat.csv, moments.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Squat with least activation and a weight on the medial contact force; check all poses on the EF.

    Exit status 2: some squats are not solved; 3: all are, but the contact model differs at some moments.
    """
    writable_folder(out)
    model = ContactSource(scene=scene).load()
    body = Body(mass_kg=mass, height_m=height, adduction_lever_mm=lever)
    squat = build(model, body, depth_deg=depth, duration_s=duration, intervals=intervals)
    results = trade_off(squat, numbers(weights, "weights"))
    solved = np.concatenate([np.full(len(r.time_s), r.solved) for r in results])
    fine = own_model(model.scene)
    verdict = judge(model, np.vstack([r.poses for r in results]), solved, fine)
    report(squat, results, verdict, fine, out)
    end_with(verdict, NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
