"""The command ``python -m problems.wear``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.contact import ElasticFoundation, grid_text
from casadi_contact.files import writable_folder
from casadi_contact.scenes import Scene, load_scene
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.common.outcome import print_verdict
from problems.wear.cycle import leap, read_path, simulated_poses
from problems.wear.problem import WEAR_FACTOR, archard_wear, check_wear_factor, volume_mm3
from problems.wear.report import report

NAME = "wear"
app = new_app()


@app.command()
def run(
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    poses: Annotated[
        Path | None,
        typer.Option(help="one closed cycle of --scene: CSV of tx_mm ... rz_rad, or .mot; simulated if left out"),
    ] = None,
    frames: Annotated[int, typer.Option(min=8, help="of the simulated cycle")] = 200,
    wear_factor: Annotated[float, typer.Option(help="[mm³/(N·m)]")] = WEAR_FACTOR,
    out: Annotated[Path, typer.Option(help="folder for wear.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Wear of the insert over a cycle, of the knee simulator or from a file, by Archard's law on the scene's EF.

    Exit status 3: on some frames of the simulated cycle the EF gives other loads than what it was simulated on.
    """
    check_wear_factor(wear_factor)  # before minutes of simulation
    writable_folder(out)
    if poses is not None:
        if scene is None or surrogate is not None:
            raise ValueError("--poses needs --scene, and no --surrogate: its elements are what wears")
        fine, verdict = _elements(load_scene(scene)), None
        cycle = read_path(poses, fine)
        if said := leap(cycle):
            typer.echo(f"{NAME}: {poses}: {said}", err=True)
    else:
        model = ContactSource.of(surrogate, scene).load()
        fine = _elements(model.scene)
        cycle = simulated_poses(model, frames)
        verdict = judge(model, cycle, np.ones(len(cycle), dtype=bool), fine)
        print_verdict(PlainConsole(), verdict)
    began = time.perf_counter()
    wear = archard_wear(fine, cycle, wear_factor)
    seconds = time.perf_counter() - began
    fewer = ElasticFoundation(fine.scene)
    coarser = {
        "every other frame": volume_mm3(archard_wear(fine, cycle[::2], wear_factor)),
        f"elements {grid_text(fewer.grid)}": volume_mm3(archard_wear(fewer, cycle, wear_factor)),
    }
    report(fine, wear, coarser, wear_factor, seconds, out)
    if verdict is not None:
        end_with(verdict, NAME, out)


def _elements(scene: Scene) -> ElasticFoundation:
    """What wears; ValueError where a scene has no elements at hand."""
    found = own_model(scene)
    if not isinstance(found, ElasticFoundation):
        raise ValueError(f"{found}: expected elements, which wear, from a surrogate or --scene that has them")
    return found


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
