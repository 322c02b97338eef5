"""The command ``python -m problems.muscle_contact``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.files.writing import writable_folder
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS
from casadi_contact.optimisation.verification.verdict import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command, worst
from problems.common.contact import ContactSource, SceneOption, SurrogateOption
from problems.muscle_contact.cocontraction import SHANK_M
from problems.muscle_contact.diagnosis import diagnose
from problems.muscle_contact.extensor import load_extensor
from problems.muscle_contact.given import (
    InverseDynamicsOption,
    MapOption,
    MusclesOption,
    ParametersOption,
    RotationsOption,
    given_walk,
    measured_cycle,
)
from problems.muscle_contact.problem import BALANCED, FREE, MARGIN_MM, build
from problems.muscle_contact.report import report
from problems.muscle_contact.solve import solve
from problems.muscle_contact.synergies import driven_by_synergies
from problems.muscle_contact.with_patella import build_with_patella, fitted_to_arms, patella_verdict

NAME = "muscle_contact"
app = new_app()


@app.command()
def run(
    inverse_dynamics: InverseDynamicsOption = None,
    muscles: MusclesOption = None,
    parameters: ParametersOption = None,
    rotations: RotationsOption = None,
    maps: MapOption = None,
    measured: Annotated[Path | None, typer.Option(help="cycle (CSV) to compare with; never used to solve")] = None,
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    out: Annotated[Path, typer.Option(help="folder for muscle_contact.csv, .sto, .png, summary.json")] = (
        RESULTS / NAME
    ),
    model: Annotated[str, typer.Option(help="hill or isometric")] = "hill",
    fit_lengths: Annotated[bool, typer.Option(help="scale fibres and tendons to the person's lengths")] = True,
    exponent: Annotated[float, typer.Option(help="of the activations in the cost")] = 3.0,
    least_activation: Annotated[float, typer.Option(help="no muscle is ever less active")] = 0.01,
    margin: Annotated[float, typer.Option(help="both sides stay closed though the load passes so many mm beside")] = (
        MARGIN_MM
    ),
    share_heads: Annotated[bool, typer.Option(help="heads of one muscle share an activation")] = True,
    ankle: Annotated[bool, typer.Option(help="the calf balances the ankle too, with soleus")] = True,
    shank: Annotated[float, typer.Option(help="length of the shank, knee to ankle [m]")] = SHANK_M,
    synergies: Annotated[int, typer.Option(min=0, help="so many drive all muscles; 0: each is driven alone")] = 0,
    activation_dynamics: Annotated[bool, typer.Option(help="activations rise in 15 ms and fall in 60 ms")] = False,
    compliant_tendons: Annotated[bool, typer.Option(help="tendons stretch by 4.9 % under the greatest force")] = False,
    patella: Annotated[
        str | None,
        typer.Option(help="quadriceps pull through the patella of this assembly: knee_with_patella, or a .toml"),
    ] = None,
    fit_patella: Annotated[
        bool, typer.Option(help="move groove and tuberosity forward until the arm of flexion is the walk's")
    ] = True,
    all_six: Annotated[
        bool, typer.Option(help="balance all six coordinates, with reserves; tx and tz are free")
    ] = False,
) -> None:
    """Find the muscle activations and contact forces of a walking cycle that balance its inverse dynamics.

    Exit status 2: some frames are not solved; 3: all are, but the contact model differs in some.
    """
    writable_folder(out)
    walk = given_walk(rotations, inverse_dynamics, muscles, parameters, maps)
    comparison = None if measured is None else measured_cycle(measured, walk)
    source = ContactSource.of(surrogate, scene)
    contact_model = source.load()
    pose_problem = build
    if patella is not None:
        extensor = load_extensor(patella, contact_model)
        extensor = fitted_to_arms(extensor, contact_model, walk) if fit_patella else extensor
        pose_problem = partial(build_with_patella, extensor=extensor)
    problem = pose_problem(
        contact_model,
        walk,
        model=model,
        fit_lengths=fit_lengths,
        balanced=tuple(COORDINATES) if all_six else BALANCED,
        free=("tx", "ty", "tz", "rx") if all_six else FREE,
        exponent=exponent,
        least_activation=least_activation,
        margin_mm=margin,
        share_heads=share_heads,
        ankle=ankle,
        shank_m=shank,
        activation_dynamics=activation_dynamics,
        compliant_tendons=compliant_tendons,
    )
    result = solve(driven_by_synergies(problem, synergies) if synergies else problem)
    balanced = result.converged & ~result.overloaded  # reserves are no muscles
    verdict = judge(contact_model, result.poses, balanced, own_model(contact_model.scene), KNEE_LOADS)
    patellar = patella_verdict(problem, result)
    report(problem, diagnose(problem, result, verdict), verdict, out, comparison, source.kind, patellar)
    end_with(worst(each for each in (verdict, patellar) if each is not None), NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
