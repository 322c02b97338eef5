"""The command ``python -m problems.muscle_driven``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import casadi_contact as cc
from casadi_contact.contact import ContactModel, ElasticFoundation
from casadi_contact.files import writable_folder
from casadi_contact.terminal import PlainConsole
from casadi_contact.verification import judge, own_model
from problems import muscle_contact
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.common.outcome import print_verdict
from problems.muscle_contact.given import (
    InverseDynamicsOption,
    MapOption,
    MusclesOption,
    ParametersOption,
    RotationsOption,
    given_walk,
)
from problems.muscle_driven.problem import build
from problems.muscle_driven.report import Run, report
from problems.muscle_driven.solve import LARGEST_ENERGY_LOST, solve

NAME = "muscle_driven"
TEACHER_GRID = (160, 80)
app = new_app()


@app.command()
def run(
    inverse_dynamics: InverseDynamicsOption = None,
    muscles: MusclesOption = None,
    parameters: ParametersOption = None,
    rotations: RotationsOption = None,
    maps: MapOption = None,
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    tolerance: Annotated[float, typer.Option(help="of CVODES, relative and absolute")] = 1e-4,
    repeats: Annotated[int, typer.Option(min=1, help="timed runs of each model, in turn")] = 3,
    out: Annotated[Path, typer.Option(help="folder for muscle_driven.csv, .png, summary.json")] = RESULTS / NAME,
) -> None:
    """Solve a walk for activations, and let these drive the knee forward on three contact models: a surrogate, the
    foundation of its scene and an EF of 160×80 elements.

    Exit status 2: a motion made or lost energy; 3: on some frames of the first one's motion the contact model differs.
    """
    writable_folder(out)
    walk = given_walk(rotations, inverse_dynamics, muscles, parameters, maps)
    source = ContactSource.of(surrogate, scene)
    model = source.load()
    inverse = muscle_contact.build(model, walk)
    solved = muscle_contact.solve(inverse)
    models: dict[str, ContactModel] = {source.kind: model}
    models.setdefault("foundation", cc.foundation(model.scene))
    models["EF 160×80"] = ElasticFoundation(model.scene, TEACHER_GRID)
    driven = {name: build(contact, inverse, solved) for name, contact in models.items()}
    simulations = [{name: solve(one, tolerance=tolerance) for name, one in driven.items()} for _ in range(repeats)]
    runs = {
        name: Run.of(one, simulations[-1][name], float(np.median([turn[name].seconds for turn in simulations])))
        for name, one in driven.items()
    }
    poses = runs[source.kind].simulation.poses
    off = {name: run.simulation.energy_lost for name, run in runs.items()}
    off = {name: lost for name, lost in off.items() if not lost <= LARGEST_ENERGY_LOST}
    verdict = judge(model, poses, np.full(len(poses), not off), own_model(model.scene))
    print_verdict(PlainConsole(), verdict)
    report(driven, runs, out)
    if off:
        lost = ", ".join(f"{100.0 * share:.2g} % on {name}" for name, share in off.items())
        print(
            f"{NAME}: not solved: the integrator made or lost {lost} of the muscles' work, expected at most "
            f"{100.0 * LARGEST_ENERGY_LOST:g} %: give a smaller --tolerance",
            file=sys.stderr,
        )
        raise typer.Exit(2)
    end_with(verdict, NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
