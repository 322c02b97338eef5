"""The command ``python -m problems.muscle_driven``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import two_digits
from casadi_contact.optimisation.muscle_contact import MuscleContact
from casadi_contact.optimisation.verification.verdict import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.muscle_contact import walk_of
from problems.muscle_driven.problem import MuscleDriven, build
from problems.muscle_driven.report import Run, differences, report
from problems.muscle_driven.solve import FARTHEST_DEG, LARGEST_ENERGY_LOST, solve

NAME = "muscle_driven"
TEACHER_GRID = (160, 80)
app = new_app()


@app.command()
def run(
    inverse_dynamics: Path | None = None,
    muscles: Path | None = None,
    parameters: Path | None = None,
    rotations: Path | None = None,
    maps: list[str] | None = None,
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    tolerance: Annotated[float, typer.Option(help="of CVODES, relative and absolute")] = 1e-4,
    repeats: Annotated[int, typer.Option(min=1, help="timed runs of each model, in turn")] = 3,
    out: Annotated[Path, typer.Option(help="folder for muscle_driven.csv, .png, summary.json")] = RESULTS / NAME,
) -> None:
    """Solve a walk for activations, and let these drive the knee forward on three contact models: a surrogate, the
    foundation of its scene and an EF of 160×80 elements.

    Exit status 2: a motion made or lost energy, or left the walk; 3: on some frames of the first one's motion the
    contact model differs.
    """
    writable_folder(out)
    walk = walk_of(rotations, inverse_dynamics, muscles, parameters, maps)
    source = ContactSource.of(surrogate, scene)
    model = source.load()
    inverse = MuscleContact(model, walk)
    solved = inverse.solve()
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
    reason = failure(driven, runs)
    verdict = judge(model, poses, np.full(len(poses), not reason), own_model(model.scene))
    report(driven, runs, verdict, out, reason)
    if reason:
        print(f"{NAME}: not solved: {reason}; see {out}", file=sys.stderr)
        raise typer.Exit(2)
    end_with(verdict, NAME, out)


def failure(driven: Mapping[str, MuscleDriven], runs: Mapping[str, Run]) -> str:
    """Why motions are not what the muscles of the walk bring about, "" where all are."""
    lost = {name: run.simulation.energy_lost for name, run in runs.items()}
    lost = {name: share for name, share in lost.items() if not share <= LARGEST_ENERGY_LOST}
    if lost:
        said = ", ".join(f"{two_digits(100.0 * share)} % on {name}" for name, share in lost.items())
        return (
            f"the integrator made or lost {said} of the muscles' work, expected at most "
            f"{100.0 * LARGEST_ENERGY_LOST:g} %: give a smaller --tolerance"
        )
    off = {name: differences(driven[name], run)["flexion_deg"] for name, run in runs.items()}
    if all(degrees <= FARTHEST_DEG for degrees in off.values()):
        return ""
    said = ", ".join(f"{two_digits(degrees)}° on {name}" for name, degrees in off.items())
    walk = next(iter(driven.values())).inverse.walk
    steps_s = np.diff(walk.time_s)
    return (
        f"the motion leaves the flexion of walk {walk.name} by {said}, expected at most {FARTHEST_DEG:g}°: cubic "
        f"splines between its frames, up to {steps_s.max():.2g} s apart after frame {steps_s.argmax()}, are not its "
        "curves; give frames closer to each other, without gaps"
    )


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
