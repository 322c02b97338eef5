"""The command ``python -m problems.pose_estimation``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.files.writing import writable_folder
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.project import reference_motion_cycles, walks
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption, warm_model
from problems.pose_estimation.estimate import cycle_warnings, estimated
from problems.pose_estimation.problem import Cycle, build
from problems.pose_estimation.report import report, report_starts
from problems.pose_estimation.solve import solve
from problems.pose_estimation.starts import solve_from_random_starts, start_from_file

NAME = "pose_estimation"
app = new_app()


@app.command()
def run(
    cycle: Annotated[Path | None, typer.Option(help="measured cycle (CSV); the scene's own if left out")] = None,
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    out: Annotated[Path, typer.Option(help="folder for pose_estimation.csv, .sto, .png and summary.json")] = (
        RESULTS / NAME
    ),
    smoothness: Annotated[float, typer.Option(help="weight of frame-to-frame change [N²/mm²]")] = 0.0,
    starts: Annotated[int, typer.Option(min=0, help="also solve from this many random starts")] = 0,
    start: Annotated[
        Path | None,
        typer.Option(help="begin at these poses (CSV, .sto), spread over the cycle, with its ry and rz"),
    ] = None,
    warm: Annotated[str | None, typer.Option(help="begin at the solution on this other surrogate")] = None,
    compiled: Annotated[
        bool, typer.Option("--compiled", help="use a compiled C kernel of the surrogate, as a foundation does")
    ] = False,
) -> None:
    """Find the poses of a cycle that match its measured loads and centres of pressure; check them on the EF.

    Frames that the surrogate or foundation cannot solve go on with the EF itself.
    Exit status 2: some frames are not solved; 3: all are, but some are not verified.
    """
    if start is not None and warm is not None:
        raise ValueError("got both --start and --warm, expected one of them")
    writable_folder(out)  # before minutes of random starts
    source = ContactSource.of(surrogate, scene)
    known = source.load_scene()
    measured = measured_cycle(known, cycle)
    for warning in cycle_warnings(known, measured):
        typer.echo(f"{NAME}: {measured.name}: {warning}", err=True)
    problem = build(source.load(), measured, smoothness, compiled=True if compiled else None)
    poses = None if start is None else start_from_file(start, problem.frames)
    if warm is not None:
        poses = solve(build(warm_model(warm, problem.model), measured)).poses
    model = own_model(problem.model.scene)
    found = estimated(problem, poses, model)
    report(problem, found, out, source.kind)
    if starts:
        report_starts(solve_from_random_starts(source, problem, found.result.poses, starts), out)
    end_with(found.verdict, NAME, out)


def measured_cycle(scene: Scene, path: Path | None) -> Cycle:
    """The cycle in a file, or that of the scene: its first one, a knee's mean walking.

    Raises ValueError for a scene that has none, and as the readers do.
    """
    if path is None and walks(scene):
        return reference_cycle()
    return reference_motion_cycles(scene, [] if path is None else [path])[0]


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
