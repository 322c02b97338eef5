"""The command ``python -m problems.assembly_poses``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.files.writing import writable_folder
from casadi_contact.optimisation.assembly.file import load_assembly
from problems.assembly_poses.check import corrected, verdicts_of
from problems.assembly_poses.cycle import read_assembly_cycle
from problems.assembly_poses.own_cycle import own_cycle
from problems.assembly_poses.problem import build
from problems.assembly_poses.report import report
from problems.assembly_poses.solve import solve
from problems.common.command import RESULTS, end_with, new_app, run_command, worst

NAME = "assembly_poses"
app = new_app()


@app.command()
def run(
    assembly: Annotated[str, typer.Option(help="ready assembly, or assembly .toml")] = "knee_with_patella",
    cycle: Annotated[Path | None, typer.Option(help="measured cycle (CSV); the assembly's own if left out")] = None,
    out: Annotated[Path, typer.Option(help="folder for assembly_poses.csv, .png and summary.json")] = RESULTS / NAME,
) -> None:
    """Find the poses of all bodies of an assembly over a cycle: one from the loads that were measured in its contact,
    all others where contacts, ligaments, pulls and applied forces balance.

    Frames in which a contact model differs from its foundation go on with the contact models.
    Exit status 2: some frames are not solved; 3: all are, but a contact model differs in some.
    """
    writable_folder(out)
    joint = load_assembly(assembly)
    given = own_cycle(joint) if cycle is None else read_assembly_cycle(cycle, joint)
    problem = build(joint, given)
    by_contact = solve(problem)
    result = corrected(assembly, problem, by_contact)
    verdicts = verdicts_of(problem, result)
    report(problem, result, verdicts, out)
    end_with(worst(verdicts.values()), NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
