"""The paper's method given its due: `two_stage` trained for ten minutes, an hour and three hours of one core in all.

Networks of 4 hidden layers grow from 15 to 30 neurons a layer [EF15 §2.6], on the samples of a preset:

    casadi-contact sample knee --preset paper --model foundation
    python -m problems.studies.two_stage_work knee --preset paper

Budgets are work (Gflop for each network of loads), so that a busy machine gives the same networks; the file says how
many seconds of a core they took. Each fit goes on from where the one of the next smaller budget ended. Errors and times
stand beside those of the scene's shipped surrogates and foundations.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Update
from casadi_contact.core.terminal import PlainConsole, progress_bars
from casadi_contact.core.workers import worker_pool
from casadi_contact.networks.network import size_text
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.candidates import surrogate_candidates, untrained_candidates
from casadi_contact.workflow.benchmark.front_file import SECONDS, Front, Point, write_front
from casadi_contact.workflow.benchmark.measure import measure
from casadi_contact.workflow.benchmark.sizes import on_disk
from casadi_contact.workflow.benchmark.walking import unseen_walking
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.project import Project, alone, read_motion, shipped_surrogates
from casadi_contact.workflow.train import structures_for_scene
from problems.common.command import new_app, run_command

NAME = "two_stage_work"
STRUCTURE = TwoStageSurrogate.structure
_SURROGATE = "surrogate.h5"
GFLOP = (2_000.0, 20_000.0, 60_000.0)
app = new_app()


@alone
def train_with_work(project: Project, gflop: Sequence[float], update: Update | None = None) -> dict[str, Surrogate]:
    """`two_stage` surrogates by their name on the chart, one for each budget of a network of loads, the smallest first;
    that of the largest budget bears the size alone. Those on disk are not trained again, interrupted ones go on, and
    each goes on from the fits of the budget before.

    Raises ValueError for a preset that does not train `two_stage` and for a scene that it does not fit.
    """
    if STRUCTURE not in structures_for_scene(project):
        raise ValueError(
            f"preset {project.preset_name} trains no {STRUCTURE} for scene {project.scene.name}, expected a preset "
            "with it (standard, paper) and a scene that presses down"
        )
    samples, efforts = project.samples(), project.preset.efforts[STRUCTURE]
    model = f"{STRUCTURE} {size_text(efforts[''].sizes[-1])}"
    made: dict[str, Surrogate] = {}
    before: Path | None = None
    with worker_pool() as workers:
        for budget in sorted(gflop):
            name = model if budget == max(gflop) else f"{model} ({budget:g} Gflop)"
            folder = project.folder / NAME / f"{budget:g}_gflop"
            path = folder / _SURROGATE
            surrogate = on_disk(project, path, samples)
            if surrogate is None:
                if before is not None and not folder.exists():
                    _copy_checkpoints(before, folder)
                chosen = {**efforts, "": replace(efforts[""], gflop=budget)}
                made_by = _command(project, [budget])
                fitting = Fitting(STRUCTURE, chosen, folder, made_by, name)
                surrogate = fit_surrogate(project, samples, fitting, update, workers)
                surrogate.save(path)
            made[name], before = surrogate, folder
    return made


def _copy_checkpoints(before: Path, folder: Path) -> None:
    """What fits go on from, as a whole: a copy that was cut off is made again."""
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(before, part, ignore=shutil.ignore_patterns(_SURROGATE))
    part.rename(folder)


def measured_front(project: Project, trained: dict[str, Surrogate], gflop: Sequence[float]) -> Front:
    """All in one run on one thread: those trained with these budgets, the scene's shipped surrogates, foundations and
    elements. That of the largest budget is a model of the chart, the others are the same one with less work."""
    candidates: list[Candidate] = list(untrained_candidates(project.scene))
    for name, surrogate in {**shipped_surrogates(project.scene), **trained}.items():
        candidates += surrogate_candidates(name, surrogate)
    settled = ElasticFoundation(project.scene, project.scene.grids["settle"])
    walking = unseen_walking(settled, read_motion(project)[0])
    less = {name: SECONDS for name in trained if name.endswith("Gflop)")}
    front = measure(candidates, project.scene, walking, project.samples(), less)
    return Front({**front.header, "command": _command(project, gflop)}, front.points)


def _command(project: Project, gflop: Sequence[float]) -> str:
    budgets = "" if tuple(gflop) == GFLOP else "".join(f" --gflop {budget:g}" for budget in gflop)
    return f"python -m problems.studies.{NAME} {project.scene.name} --preset {project.preset_name}{budgets}"


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="a ready scene, or the path of a .toml")] = "knee",
    preset: Annotated[str, typer.Option(help="whose samples, and whose networks of two_stage")] = "paper",
    gflop: Annotated[list[float] | None, typer.Option(min=0.001, help="work for each network of loads")] = None,
    out: Annotated[Path | None, typer.Option(help="project folder; results/SCENE-PRESET if left out")] = None,
) -> None:
    """Train two_stage with several budgets, and measure them beside other models in one run."""
    project, budgets = Project.open(scene, preset, out), gflop or GFLOP
    console = PlainConsole()
    with progress_bars(console) as update:
        trained = train_with_work(project, budgets, update)
    front = measured_front(project, trained, budgets)
    path = project.folder / f"{NAME}.csv"
    write_front(path, front)
    console.print(_table(front.points))
    typer.echo(f"results in {path}")


def _table(points: Sequence[Point]) -> Table:
    domains = [domain for domain in ("D1", "D3", "D4") if any(domain in p.domain_force_rms_n for p in points)]
    table = Table("model", "trained [min]", "µs", "force [N]", "torque [N·mm]", *(f"{d} force [N]" for d in domains))
    for p in points:
        of_domains = (f"{p.domain_force_rms_n[d]:.3g}" if d in p.domain_force_rms_n else "" for d in domains)
        time = "" if p.value is None else f"{p.value.median_us:.3g}"
        trained = f"{p.training_seconds / 60.0:.3g}" if p.samples else ""
        table.add_row(p.name, trained, time, f"{p.force_rms_n:.3g}", f"{p.torque_rms_nmm:.3g}", *of_domains)
    return table


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
