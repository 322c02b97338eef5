"""The command ``python -m problems.design``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import numbers
from casadi_contact.scenes.loading import load_scene
from problems.common.command import RESULTS, new_app, run_command
from problems.design.dish import DishContact
from problems.design.problem import Bounds, build
from problems.design.report import agrees, report, report_unsolved, unsettled
from problems.design.solve import on_elements, solve

NAME = "design"
app = new_app()


@app.command()
def run(
    scene: Annotated[str, typer.Option(help="ready scene or scene .toml of the shape knee")] = "knee",
    ap: Annotated[str, typer.Option(help="least and largest anterior-posterior travel [mm] under ±100 N")] = "5,8",
    ml: Annotated[str, typer.Option(help="least and largest medial-lateral travel [mm] under ±50 N")] = "0.5,2",
    frames: Annotated[int, typer.Option(min=2, help="of the walking cycle")] = 12,
    out: Annotated[Path, typer.Option(help="folder for design.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Find the dish radii with the lowest peak pressure over walking at bounded laxity; check them on the EF.

    Exit status 2: not solved; 3: solved, but the EF finds another peak pressure or laxity, or no equilibrium.
    """
    writable_folder(out)
    design = build(DishContact(load_scene(scene)), Bounds(_pair(ap, "ap"), _pair(ml, "ml")), frames)
    result = solve(design)
    if not result.solved:
        said = f"{result.ipopt_status}; no dish is found that allows this travel: widen --ap and --ml"
        if result.first.reason:
            said = f"the scene's own dish, where the search begins, does not carry {result.first.reason}"
            said += "; begin with smaller dish radii"
        report_unsolved(design, result, said, out)
        print(f"{NAME}: not solved: {said}; see {out}", file=sys.stderr)
        raise typer.Exit(2)
    checked = {"first": on_elements(design, result.first), "best": on_elements(design, result.best)}
    report(design, result, checked, out)
    lost = unsettled(checked)
    if lost or not agrees(result.best, checked["best"]):
        why = "; ".join(lost) or "the contact model differs"
        print(f"{NAME}: solved, but {why}; see {out}", file=sys.stderr)
        raise typer.Exit(3)


def _pair(text: str, option: str) -> tuple[float, float]:
    found = numbers(text, option)
    if len(found) != 2:
        raise ValueError(f"--{option} is {text!r}, expected two numbers separated by a comma")
    return found[0], found[1]


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
