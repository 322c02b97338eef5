"""The command ``python -m problems.calibration``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

import casadi_contact as cc
from casadi_contact.contact.parameters import check_parameters
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.scenes.columns import write_columns
from problems.calibration.measurement import TRUTH, read_measurement, synthetic_measurement
from problems.calibration.problem import DEFAULT, build
from problems.calibration.report import report, report_starts, rivals
from problems.calibration.solve import CalibrationResult, random_starts, solve
from problems.common.command import RESULTS, new_app, run_command

NAME = "calibration"
_ALONE = 0.5  # of the sum of squares: as much in one frame is an error there, not of units or parameters
_FRAMES = 8  # fewer, and half of the sum is no wonder
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
    seed: Annotated[int, typer.Option(min=0, help="of the made-up noise")] = 1,
    force_n: Annotated[float, typer.Option(help="standard deviation of measured forces [N]")] = 5.0,
    torque_nmm: Annotated[float, typer.Option(help="of measured torques [N·mm]")] = 100.0,
    length_mm: Annotated[float, typer.Option(help="of measured positions [mm]")] = 0.01,
    angle_rad: Annotated[float, typer.Option(help="of measured angles [rad]")] = 2e-4,
    starts: Annotated[int, typer.Option(min=0, help="also solve from this many random starts")] = 10,
    out: Annotated[Path, typer.Option(help="folder for calibration.csv, .png, .json, made_up.csv")] = RESULTS / NAME,
) -> None:
    """Estimate material and placement of the insert from poses and loads, with their uncertainty.

    Exit status 2: not solved, the foundation with these parameters does not explain the data, some parameters cannot
    be told apart by them, or random starts find other estimates that explain them as well.
    """
    writable_folder(out)
    model = cc.foundation(scene)
    names = check_parameters((name.strip() for name in parameters.split(",")), model.scene.material)
    deviations = {"force_n": force_n, "torque_nmm": torque_nmm, "length_mm": length_mm, "angle_rad": angle_rad}
    truth = None
    if measured is not None:
        if measured.resolve() == (out / "calibration.csv").resolve():
            raise ValueError(f"--measured {measured} is where the estimates go: rename it, or give another --out")
        data = read_measurement(measured, model, **deviations)
    else:
        truth = {name: TRUTH[name] for name in names}
        data = synthetic_measurement(model, truth, frames=frames, motion=motion, noise=noise, seed=seed, **deviations)
        write_columns(out / "made_up.csv", data.columns())
    problem = build(model, data, names)
    result = solve(problem)
    report(problem, result, truth, out)
    count = starts if result.uncertainty.identifiable.any() else 0  # else there is no estimate to reach again
    others = [solve(problem, start) for start in random_starts(problem, count)]
    if others:
        report_starts(problem, result, others, truth, out)
    if reason := failure(result, rivals(problem, result, others)):
        print(f"{NAME}: {reason}", file=sys.stderr)
        raise typer.Exit(2)


def failure(result: CalibrationResult, as_good: Sequence[CalibrationResult] = ()) -> str:
    """Why the estimates are not to be used, or nothing. What the data leave open is told of an unsolved problem too: it
    may be why there is no minimum to end at. as_good: other estimates that explain the data as well."""
    found = [] if result.solved else [f"not solved: {result.ipopt_status}"]
    if not result.explained:
        said = f"the sum of squares is {result.misfit:.3g} times its degrees of freedom"
        worst = int(result.shares.argmax())
        if len(result.shares) >= _FRAMES and result.shares[worst] > _ALONE:
            found.append(
                f"{said}, and frame {worst} alone has {100.0 * result.shares[worst]:.0f} % of it: leave that frame "
                "out, or mend what was measured there"
            )
        elif not result.solved:
            found.append(
                f"{said}: are poses in mm and rad in the scene's frame, and loads in N and N·mm on the fixed body?"
            )
        else:
            found.append(
                f"the foundation with these parameters does not explain these data: {said}, at most "
                f"{result.largest_misfit:.3g} expected; free more parameters, or state larger deviations if the "
                "measurement is less certain"
            )
    if result.uncertainty.at_bound:
        found.append(f"at the bound of the search: {', '.join(result.uncertainty.at_bound)}")
    if result.uncertainty.tied:
        groups = "; ".join(" and ".join(group) for group in result.uncertainty.tied)
        found.append(f"these data do not tell apart: {groups}; leave one of them to the scene, or measure more")
    if as_good:
        other = dict(zip(result.uncertainty.parameters, as_good[0].values, strict=True))
        values = ", ".join(f"{name} {value:.4g}" for name, value in other.items())
        found.append(
            f"{len(as_good)} of the random starts end at other estimates that explain these data as well, such as "
            f"{values}; leave a parameter to the scene, or measure more"
        )
    return "; ".join(found)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
