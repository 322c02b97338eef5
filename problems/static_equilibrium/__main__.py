"""The command ``python -m problems.static_equilibrium``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import POSE_NAMES, pose_index
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import numbers
from casadi_contact.optimisation.starts import middle_pose
from casadi_contact.optimisation.verification.verdict import judge, own_model
from problems.common.command import RESULTS, end_with, new_app, run_command
from problems.common.contact import ContactSource, SceneOption, SurrogateOption, warm_model
from problems.common.learned_range import reasons
from problems.static_equilibrium.diagnosis import diagnose
from problems.static_equilibrium.problem import FREE, SOFT_TISSUE, StaticEquilibrium, build
from problems.static_equilibrium.report import report, report_starts
from problems.static_equilibrium.search import search
from problems.static_equilibrium.solve import solve
from problems.static_equilibrium.starts import solve_from_lifts

NAME = "static_equilibrium"
app = new_app()


@app.command()
def run(
    surrogate: SurrogateOption = None,
    scene: SceneOption = None,
    fx: Annotated[float, typer.Option(help="posterior force on the insert [N]")] = -100.0,
    fy: Annotated[float, typer.Option(help="vertical force on the insert, compression negative [N]")] = -1500.0,
    fz: Annotated[float, typer.Option(help="medial force on the insert [N]")] = 0.0,
    tx: Annotated[float, typer.Option(help="torque about x, at the moving origin [N·mm]")] = 7500.0,
    ty: Annotated[float, typer.Option(help="torque about y [N·mm]")] = -2000.0,
    tz: Annotated[float, typer.Option(help="torque about z [N·mm]; balanced by the lock while rz is locked")] = 0.0,
    flexions: Annotated[str, typer.Option(help="flexion angles [deg], separated by commas")] = "0,5,15,30,45,60,75",
    soft: Annotated[bool, typer.Option(help="free rz too, with soft-tissue springs slack at the flexion")] = False,
    starts: Annotated[int, typer.Option(min=0, help="random starts, of unsolved rows and of solved ones again")] = 20,
    warm: Annotated[str | None, typer.Option(help="begin at the solution on this other surrogate")] = None,
    out: Annotated[Path, typer.Option(help="folder for static_equilibrium.csv, .png, .json")] = RESULTS / NAME,
) -> None:
    """Find the poses that carry six loads over flexion; check them on the EF and from random starts.

    Exit status 2: some loads have no equilibrium; 3: all have, but the contact model differs in some.
    """
    writable_folder(out)
    source = ContactSource.of(surrogate, scene)
    model = source.load_whole()
    space, angles = model.scene.pose_space, np.radians(numbers(flexions, "flexions"))
    space.free_curves({"rz": -angles}, "flexions")
    rest = np.tile(middle_pose(model), (len(angles), 1))
    neutral = [pose_index(name) for name in ("tx", "tz", "ry")]
    rest[:, neutral] = model.scene.start_pose[neutral]
    rest[:, pose_index("rz")] = -angles
    rest = space.onto(rest)
    loads = np.tile([fx, fy, fz, tx, ty, tz], (len(angles), 1))
    free = [name for name in (POSE_NAMES if soft else FREE) if not space.bound(name)]
    springs = np.array([SOFT_TISSUE[name] for name in POSE_NAMES]) if soft else None

    def on(chosen: SymbolicContact) -> StaticEquilibrium:
        return build(chosen, loads, free=free, rest=rest, stiffness=springs, about="moving")

    problem = on(model)
    result = solve(problem, None if warm is None else solve(on(warm_model(warm, model))).poses)
    result = search(problem, result, starts)
    foundation = own_model(model.scene)
    result = diagnose(problem, result, foundation)
    verdict = judge(model, result.poses, result.converged, foundation)
    result = replace(result, reason=reasons(model, result.poses, verdict, result.reason))
    report(problem, result, verdict, out, source.kind)
    if starts and result.converged.any():
        report_starts(solve_from_lifts(problem, result, starts), out)
    end_with(verdict, NAME, out, "rows")


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
