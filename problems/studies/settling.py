"""From how far static analysis finds back: random starts about the poses of a measured cycle, on a scene's foundation.

The cycle is solved first (`problems.pose_estimation`). Each start is the pose of one of its frames with every free
parameter moved at random, and settles under the frame's measured loads (`cc.settle`), on its own.

Run ``python -m problems.studies.settling problems/implant/tka_mesh.toml walk1.csv``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from casadi_contact.contact.settle import settle
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import pose_index
from casadi_contact.workflow.project import reference_motion_cycles
from problems.common.command import new_app, run_command
from problems.common.contact import ContactSource
from problems.common.same_poses import same_poses
from problems.pose_estimation.problem import Cycle, build
from problems.pose_estimation.solve import solve

NAME = "studies.settling"
_TOLERANCE_N = 0.01
_MOST_ASIDE_MM, _MOST_TURNED_DEG = 1000.0, 180.0
app = new_app()


@dataclass(frozen=True)
class SettledStarts:
    """Of each start (n,): whether it settles, whether at the pose of its frame, Newton steps, and why not."""

    converged: np.ndarray
    same: np.ndarray
    iterations: np.ndarray
    reason: np.ndarray

    def __str__(self) -> str:
        return (
            f"{int(self.converged.sum())} of {len(self.converged)} random starts settle, {int(self.same.sum())} of "
            f"them at the pose of the cycle; {np.median(self.iterations):.0f} steps in the median, "
            f"{self.iterations.max()} at most"
        )


def settled_starts(
    model: SymbolicContact, cycle: Cycle, count: int, aside_mm: float, turned_rad: float
) -> SettledStarts:
    """Settle `count` starts moved by up to aside_mm along and turned_rad about every free axis.

    Raises ValueError for starts further off than 1,000 mm or 180 degrees, for a cycle of which no frame has a pose on
    the model, and for one whose centres of pressure lack the forces that they belong to.
    """
    for name, most, unit, limit in (
        ("aside", aside_mm, "mm", _MOST_ASIDE_MM),
        ("turned", float(np.degrees(turned_rad)), "degrees", _MOST_TURNED_DEG),
    ):
        if not 0.0 <= most <= limit:
            raise ValueError(f"{name} is {most:g} {unit}, expected 0 to {limit:g}")
    problem = build(model, cycle)
    solved, targets = solve(problem), problem.wanted.targets()
    frames = np.flatnonzero(solved.converged)
    if not len(frames) or targets is None:
        raise ValueError(f"cycle {cycle.name}: no frame has a pose that carries forces and centres of pressure")
    random = np.random.default_rng(0)
    rows = random.choice(frames, count)
    poses = solved.poses[rows]
    starts = poses.copy()
    for name in problem.free:
        most = turned_rad if name.startswith("r") else aside_mm
        starts[:, pose_index(name)] += random.uniform(-most, most, count)
    wanted = {name: curve[rows] for name, curve in targets.items()}
    found, report = settle(model, starts, problem.free, wanted, tolerance=_TOLERANCE_N)
    same = report.converged & same_poses(found, poses)
    return SettledStarts(report.converged, same, report.iterations, report.reason)


@app.command()
def run(
    scene: Annotated[Path, typer.Argument(help="scene file, or a ready scene")],
    cycle: Annotated[Path, typer.Argument(help="measured cycle (CSV)")],
    starts: Annotated[int, typer.Option(min=1, help="random starts")] = 200,
    aside: Annotated[float, typer.Option(help="along every free axis, at most [mm]")] = 2.0,
    turned: Annotated[float, typer.Option(help="about every free axis, at most [degrees]")] = 5.0,
) -> None:
    """Say how many random starts about a measured cycle settle. Exit status 2: some do not."""
    model = ContactSource(scene=str(scene)).load()
    (measured,) = reference_motion_cycles(model.scene, [cycle])
    found = settled_starts(model, measured, starts, aside, np.radians(turned))
    typer.echo(f"{found}")
    if not found.converged.all():
        typer.echo(f"settling: {found.reason[~found.converged][0]}", err=True)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
