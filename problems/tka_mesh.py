"""From the mesh files of a real knee implant to the poses of measured cycles, in one command.

The scene file (`tka_mesh.toml`) names the meshes. The surrogate is sampled, trained, evaluated and exported into one
folder (as ``casadi-contact build`` does; run again, it goes on from what is there), then the poses of each cycle are
estimated with it (`problems.pose_estimation`) and checked on the elastic foundation of the meshes.

Run ``python -m problems.tka_mesh --help``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from casadi_contact import cli
from casadi_contact.files import file_stem
from casadi_contact.motion.load_cycle import read_cycle
from casadi_contact.presets import PRESETS
from casadi_contact.scenes import load_scene
from casadi_contact.structures import load_surrogate
from problems.command import run_command
from problems.pose_estimation import build, solve
from problems.pose_estimation_report import report
from problems.pose_estimation_starts import start_from_file

SCENE = Path(__file__).with_suffix(".toml")

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    cycles: Annotated[list[Path], typer.Argument(help="measured cycles (CSV) to find the poses of")],
    scene: Annotated[Path, typer.Option(help="scene file that names the meshes")] = SCENE,
    start: Annotated[Path | None, typer.Option(help="begin at these measured poses (CSV, .sto; tx ... rz)")] = None,
    preset: Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")] = "quick",
    out: Annotated[Path | None, typer.Option(help="folder of all results; results/SCENE-PRESET if left out")] = None,
) -> None:
    """Build the surrogate of a knee from its meshes and find the poses of measured cycles with it.

    Frames without a pose are named with the reason, and make the exit status 2.
    """
    measured = [read_cycle(path) for path in cycles]  # before minutes of training
    poses = [None if start is None else start_from_file(start, len(cycle)) for cycle in measured]
    folder = Path("results") / f"{file_stem(load_scene(scene).name)}-{preset}" if out is None else out
    cli.build(str(scene), preset=preset, out=folder)
    surrogate, solved = load_surrogate(folder / "patch.h5"), True
    for path, cycle, first in zip(cycles, measured, poses, strict=True):
        problem = build(surrogate, cycle, compiled=True)
        result = solve(problem, first)
        report(problem, result, folder / "poses" / path.stem)
        solved &= bool(result.converged.all())
    if not solved:
        Console(stderr=True).print("tka_mesh: some frames have no pose; reasons above", highlight=False)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; unsolved frames are exit status 2."""
    run_command(app, "tka_mesh")


if __name__ == "__main__":
    main()
