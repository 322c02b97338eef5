"""The command ``python -m problems.calibration``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

import casadi_contact as cc
from casadi_contact.contact.parameters import check_parameters
from casadi_contact.files import writable_folder
from casadi_contact.motion.columns import write_columns
from problems.calibration.measurement import TRUTH, read_measurement, synthetic_measurement
from problems.calibration.problem import DEFAULT, build
from problems.calibration.report import report
from problems.calibration.solve import random_starts, solve
from problems.common.command import RESULTS, new_app, run_command

NAME = "calibration"
app = new_app()


@app.command()
def run(
    measured: Annotated[
        Path | None,
        typer.Option(help="CSV of tx_mm ... rz_rad, Fy_med_N ...; made up with known truth if left out"),
    ] = None,
    scene: Annotated[str, typer.Option(help="ready scene or scene .toml whose foundation is calibrated")] = "knee",
    parameters: Annotated[str, typer.Option(help="of the foundation, separated by commas")] = ",".join(DEFAULT),
    frames: Annotated[int, typer.Option(min=4, help="of the made-up measurement")] = 30,
    motion: Annotated[str, typer.Option(help="of the made-up measurement: walking, or pressing")] = "walking",
    noise: Annotated[float, typer.Option(min=0.0, help="of the made-up measurement, times the deviations")] = 1.0,
    seed: Annotated[int, typer.Option(help="of the made-up noise")] = 1,
    force_n: Annotated[float, typer.Option(help="standard deviation of measured forces [N]")] = 5.0,
    torque_nmm: Annotated[float, typer.Option(help="of measured torques [N·mm]")] = 100.0,
    length_mm: Annotated[float, typer.Option(help="of measured positions [mm]")] = 0.01,
    angle_rad: Annotated[float, typer.Option(help="of measured angles [rad]")] = 2e-4,
    starts: Annotated[int, typer.Option(min=0, help="also solve from this many random starts")] = 10,
    out: Annotated[Path, typer.Option(help="folder for calibration.csv, measured.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Estimate material and placement of the insert from poses and loads, with their uncertainty.

    Exit status 2: not solved, or some parameters cannot be told apart by these data.
    """
    writable_folder(out)
    model = cc.foundation(scene)
    names = check_parameters((name.strip() for name in parameters.split(",")), model.scene.material)
    deviations = {"force_n": force_n, "torque_nmm": torque_nmm, "length_mm": length_mm, "angle_rad": angle_rad}
    truth = None
    if measured is not None:
        data = read_measurement(measured, model, **deviations)
    else:
        truth = {name: TRUTH[name] for name in names}
        data = synthetic_measurement(model, truth, frames=frames, motion=motion, noise=noise, seed=seed, **deviations)
    problem = build(model, data, names)
    write_columns(out / "measured.csv", data.columns())
    result = solve(problem)
    others = [solve(problem, start) for start in random_starts(problem, starts)]
    report(problem, result, others, truth, out)
    if not (result.solved and result.uncertainty.identifiable.all()):
        groups = "; ".join(" and ".join(group) for group in result.uncertainty.tied)
        what = f"these data do not tell apart: {groups}" if groups else f"not solved: {result.ipopt_status}"
        print(f"{NAME}: {what}", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
