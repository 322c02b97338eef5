"""A walking cycle beyond what a surrogate learned: more load, more flexion, brought to tolerance by `refine`.

The reference cycle with its forces multiplied and its flexion increased is solved by pose estimation, verified on the
elastic foundation's teacher grid, and as long as that fails the surrogate learns around the failing frames. Needs the
samples that the surrogate was trained on: a folder made by ``casadi-contact build``.

Run ``python -m problems.studies.refine_beyond --project results/knee-quick``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.workers import worker_pool
from casadi_contact.networks.training.parallel import fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.verification.verdict import judge
from casadi_contact.samples.samples import Samples, read_samples
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.load_cycle import LoadCycle
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.info import samples_record
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.refine import Refinement, Solve, refine
from problems import pose_estimation
from problems.common.command import RESULTS, new_app, run_command
from problems.common.records import pose_columns

WALKING_DOMAINS = ("D1", "D5", "D7")
WALKING_ONLY_GFLOP = 600.0  # training of each root network


def beyond(cycle: LoadCycle, loads: float, flexion_deg: float) -> LoadCycle:
    """The cycle with its forces times `loads`, and `flexion_deg` more flexion (rz is negative) in every frame."""
    return replace(
        cycle,
        name=f"{cycle.name}, {loads:g} times the loads, {flexion_deg:g}° more flexion",
        rz=cycle.rz - np.deg2rad(flexion_deg),
        fy_med=loads * cycle.fy_med,
        fy_lat=loads * cycle.fy_lat,
    )


def walking_only(samples: Samples, gflop: float) -> tuple[Surrogate, Samples]:
    """A patch surrogate of the samples around walking alone (D1, and D5 and D7 for liftoff), and those samples.

    Roots have 16-16-16 neurons, ratios 12-12 and a quarter of the work.
    """
    narrow = samples.select(domain=WALKING_DOMAINS)
    regressions = PatchSurrogate.regressions(narrow)
    settings = {
        r.name: TrainingSettings(sizes=((16, 16, 16),), max_gflop=gflop)
        if r.name.startswith("root")
        else TrainingSettings(sizes=((12, 12),), max_gflop=0.25 * gflop)
        for r in regressions
    }
    with worker_pool() as workers:
        fits = fit_all([replace(r, tolerance=0.2 * r.tolerance) for r in regressions], settings, workers)
    networks = {name: fit.network for name, fit in fits.items()}
    return with_trust(PatchSurrogate(samples.scene, networks, samples_record(narrow)), narrow), narrow


def build(cycle: LoadCycle, tell: Callable[[str], None] | None = None) -> Solve:
    """The problem that `refine` solves again and again: surrogate -> poses of the cycle, and which frames converged."""

    def solve(surrogate: Surrogate) -> tuple[Array, np.ndarray]:
        result = pose_estimation.solve(pose_estimation.build(surrogate, cycle))
        if tell is not None:
            tell(f"{int(result.converged.sum())} of {len(cycle)} frames converged")
        return result.poses, result.converged

    return solve


def report(result: Refinement, path: Path) -> None:
    """One row for each solution: samples added and seconds spent before it, RMS of each load, frames outside."""
    checks = result.verifications
    columns: dict[str, Any] = {
        "round": range(len(checks)),
        "samples_added": [0, *result.added],
        "seconds": [f"{seconds:.1f}" for seconds in (0.0, *result.seconds)],
        "passed": [check.passed for check in checks],
        "unsolved": [int((~check.solved).sum()) for check in checks],
        "outside": [int(check.outside.sum()) for check in checks],
    }
    for column, name in enumerate(result.surrogate.load_names):
        columns[f"rms_{name}"] = [check.rms[column] for check in checks]
    write_columns(path, columns, digits=4)


NAME = "refine_beyond"
app = new_app()


@app.command()
def run(
    project: Annotated[Path, typer.Option(help="folder of a built scene, with samples.h5 and the surrogate")],
    structure: Annotated[str, typer.Option(help="patch or two_stage")] = "patch",
    loads: Annotated[float, typer.Option(help="factor on the forces")] = 2.0,
    flexion: Annotated[float, typer.Option(help="additional flexion [degrees]")] = 40.0,
    frames: Annotated[int, typer.Option(min=2, help="frames of the cycle")] = 101,
    rounds: Annotated[int, typer.Option(min=0, help="refinements at most")] = 3,
    gflop: Annotated[
        float, typer.Option(help="training at most, for each network in each round [10⁹ operations]")
    ] = 300.0,
    narrow: Annotated[bool, typer.Option("--walking-only", help="begin with what walking alone teaches")] = False,
    out: Annotated[Path, typer.Option(help="folder for refine_beyond.csv, frames.csv and refined.h5")] = RESULTS / NAME,
) -> None:
    """Solve a cycle outside the learned region, verify the solution, and refine the surrogate until it passes."""
    writable_folder(out)  # before minutes of training
    samples = read_samples(project / "samples.h5")
    if narrow:
        surrogate, samples = walking_only(samples, WALKING_ONLY_GFLOP)
    else:
        surrogate = load_surrogate(project / f"{structure}.h5")
    cycle = beyond(reference_cycle(frames), loads, flexion)
    teacher = ElasticFoundation(surrogate.scene, surrogate.scene.grids["teacher"])
    result = refine(surrogate, samples, build(cycle, print), teacher, rounds=rounds, gflop=gflop, progress=print)
    check = result.verifications[-1]
    print(check)
    verdict = judge(result.surrogate, check.poses, check.solved, teacher)
    print(verdict)
    write_columns(out / "frames.csv", {"percent": cycle.percent, **pose_columns(check.poses), "verdict": verdict.words})
    print(f"{cycle.name}: {len(result.added)} rounds, {sum(result.added)} samples, {sum(result.seconds):.0f} s")
    report(result, out / "refine_beyond.csv")
    if result.added:
        result.surrogate.save(out / "refined.h5")
    print(f"results in {out}")
    if not result.passed:
        print(f"refine_beyond: not within tolerance after {rounds} rounds", file=sys.stderr)
        raise typer.Exit(2)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1; a failed refinement is exit status 2."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
