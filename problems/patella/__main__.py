"""The command ``python -m problems.patella``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import casadi_contact as cc
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.optimisation.knee import KNEE_LOADS
from casadi_contact.optimisation.muscle_contact import MuscleContact, columns_of
from casadi_contact.optimisation.verification.verdict import judge, own_model
from casadi_contact.scenes.columns import write_columns
from problems.common.command import RESULTS, end_with, new_app, run_command, worst
from problems.common.outcome import rows_in_words
from problems.common.records import DIGITS, add_to_summary, assembly_columns, pose_columns, write_summary
from problems.muscle_contact import walk_of
from problems.patella.follow import LEAST_TENSION_N, SAME_N, follow, start_poses

NAME = "patella"
app = new_app()


@app.command()
def run(
    inverse_dynamics: Path | None = None,
    muscles: Path | None = None,
    parameters: Path | None = None,
    rotations: Path | None = None,
    maps: list[str] | None = None,
    starts: Annotated[int, typer.Option(min=0, help="settle from this many random starts too, frame by frame")] = 0,
    out: Annotated[Path, typer.Option(help="folder for patella.csv and summary.json")] = RESULTS / NAME,
) -> None:
    """Solve a walk for muscle forces and the femur's poses, and let the quadriceps pull the patella of
    `knee_with_patella` along.

    Exit status 2: muscles do not balance the walk, or the patella is in no equilibrium, in some frames; 3: they do, but
    a contact model differs.
    """
    writable_folder(out)
    walk = walk_of(rotations, inverse_dynamics, muscles, parameters, maps)
    through = columns_of(walk.muscles.names, "recf", "rect_f", "vas")
    knee = cc.load_surrogate("knee")
    solved = MuscleContact(knee, walk).solve()
    balanced = solved.solved
    walked = judge(knee, solved.poses, balanced, own_model(knee.scene), KNEE_LOADS)
    tension = solved.muscle_forces_n[:, through].sum(axis=1)
    ride = follow(cc.load_assembly("knee_with_patella"), solved.poses, tension)
    verdict, console = ride.verdict("patellofemoral"), PlainConsole()
    console.print(f"muscles and femur: {walked}", highlight=False, soft_wrap=True)
    console.print(f"patellofemoral contact: {verdict}", highlight=False, soft_wrap=True)
    if (slack := tension < LEAST_TENSION_N).any():
        said = f"quadriceps are slack in frames {rows_in_words(slack)}: there they pull by {LEAST_TENSION_N:g} N"
        console.print(said, highlight=False, soft_wrap=True)
    columns = {"time_s": walk.time_s, "quadriceps_N": tension, **pose_columns(ride.poses[:, 1])}
    columns |= assembly_columns(ride.assembly.load_kinds, ride.loads) | {"residual_N": ride.residual_n}
    write_columns(out / "patella.csv", columns, digits=DIGITS)
    summary = {"walk": walk.name, "femur_verdict": str(walked), "verdict": str(verdict)}
    write_summary(out / "summary.json", summary | {"largest_residual_N": float(ride.residual_n.max())})
    console.print(f"results in {out}", highlight=False)
    reached = []
    for seed in range(starts):
        again = follow(ride.assembly, solved.poses, tension, start_poses(ride, np.random.default_rng(seed)))
        reached.append(float((again.converged & (ride.loads_apart_n(again) < SAME_N)).mean()))
    if reached:
        whole = sum(share == 1.0 for share in reached)
        share = f"{100 * np.mean(reached):.2f} % of frames"
        console.print(f"{whole} of {starts} random starts find the same loads in all frames, {share}", highlight=False)
        add_to_summary(out / "summary.json", {"random_starts": reached})
    end_with(worst((walked, verdict)), NAME, out)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
