"""From the mesh files of a real knee implant to the poses of measured cycles, in one command.

The scene file (`tka_mesh.toml`) names the meshes. The surrogate is sampled, trained, evaluated and exported into one
folder (as ``casadi-contact build`` does; run again, it goes on from what is there), then the poses of each cycle are
estimated with it (`problems.pose_estimation`) and checked on the elastic foundation of the meshes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact import cli
from casadi_contact.files import file_stem
from casadi_contact.motion.load_cycle import read_cycle
from casadi_contact.presets import PRESETS
from casadi_contact.scenes import load_scene
from casadi_contact.structures import load_surrogate
from casadi_contact.verification import judge, own_model
from problems.common.command import RESULTS, new_app, run_command
from problems.implant import SCENE
from problems.pose_estimation.problem import LOADS, build
from problems.pose_estimation.report import report
from problems.pose_estimation.solve import solve
from problems.pose_estimation.starts import start_from_file

NAME = "implant"
app = new_app()


@app.command()
def run(
    cycles: Annotated[list[Path], typer.Argument(help="measured cycles (CSV) to find the poses of")],
    scene: Annotated[Path, typer.Option(help="scene file that names the meshes")] = SCENE,
    start: Annotated[Path | None, typer.Option(help="begin at these measured poses (CSV, .sto; tx ... rz)")] = None,
    preset: Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")] = "quick",
    out: Annotated[
        Path | None, typer.Option(help="folder of all results; results/implant/SCENE-PRESET if left out")
    ] = None,
) -> None:
    """Build the surrogate of a knee from its meshes and find the poses of measured cycles with it.

    Exit status 2: some frames are not solved, and are named with the reason; 3: all are, but the contact model of the
    meshes differs in some.
    """
    measured = [read_cycle(path) for path in cycles]  # before minutes of training
    poses = [None if start is None else start_from_file(start, len(cycle)) for cycle in measured]
    folder = RESULTS / NAME / f"{file_stem(load_scene(scene).name)}-{preset}" if out is None else out
    cli.build(str(scene), preset=preset, out=folder)
    surrogate = load_surrogate(folder / "patch.h5")
    foundation, codes = own_model(surrogate.scene), []
    for path, cycle, first in zip(cycles, measured, poses, strict=True):
        problem = build(surrogate, cycle, compiled=True)
        result = solve(problem, first)
        verdict = judge(surrogate, result.poses, result.converged, foundation, LOADS)
        report(problem, result, verdict, folder / "poses" / path.stem)
        codes.append(verdict.exit_code)
    if any(codes):
        worst = "some frames have no pose" if 2 in codes else "the contact model differs in some frames"
        typer.echo(f"{NAME}: {worst}; see above", err=True)
        raise typer.Exit(2 if 2 in codes else 3)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
