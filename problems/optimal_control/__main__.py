"""The command ``python -m problems.optimal_control``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.files import writable_folder
from casadi_contact.verification import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.optimal_control.carried import missed
from problems.optimal_control.forward import forward_poses, strays
from problems.optimal_control.problem import build
from problems.optimal_control.report import report
from problems.optimal_control.solve import solve
from problems.optimal_control.wanted_cycle import cycle_of

NAME = "optimal_control"
app = new_app()


@app.command()
def run(
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    intervals: Annotated[int, typer.Option(help="collocation intervals over the cycle")] = 50,
    degree: Annotated[int, typer.Option(help="collocation points of each interval")] = 3,
    scheme: Annotated[str, typer.Option(help="radau or legendre")] = "radau",
    periodic: Annotated[bool, typer.Option(help="end where the cycle began")] = True,
    steadiness: Annotated[float, typer.Option(help="weight of the actuators' change from point to point")] = 1e-4,
    out: Annotated[Path, typer.Option(help="folder for optimal_control.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Find the actuator loads and the motion that carry the contact loads of a cycle; check them on the EF.

    The cycle is the knee simulator's, for a joint that is pressed otherwise than down that of its scene.

    Exit status 2: not solved, wanted loads are missed, or forward in time the actuators lead elsewhere; 3: solved, but
    the contact model differs at some collocation points.
    """
    writable_folder(out)
    source = ContactSource.of(surrogate, scene)
    model = source.load_whole()
    wanted = cycle_of(model)
    problem = build(
        model,
        wanted,
        intervals=intervals,
        degree=degree,
        scheme=scheme,
        periodic=periodic,
        steadiness=steadiness,
    )
    result = solve(problem)
    forward = forward_poses(problem, result) if result.converged else None
    unsolved = missed(problem, result) or strays(problem, result, forward)
    solved = np.full(len(result.poses), not unsolved)
    verdict = judge(model, result.poses, solved, own_model(model.scene))
    report(problem, result, verdict, out, source.kind, forward, unsolved)
    if unsolved:
        print(f"{NAME}: not solved: {unsolved}; see {out}", file=sys.stderr)
        raise typer.Exit(2)
    end_with(verdict, NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
