"""The command line: ``casadi-contact build | sample | train | evaluate | export | info | show``, thin over it all."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from casadi_contact import pipeline
from casadi_contact.contact import ElasticFoundation
from casadi_contact.pipeline import PRESETS, Project
from casadi_contact.report import evaluation_tables, read_evaluation
from casadi_contact.scenes import load_scene
from casadi_contact.show import draw_contact, neutral_pose, read_poses, surface_fits
from casadi_contact.surrogate import load_surrogate

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__, pretty_exceptions_enable=False)
console = Console()

SceneName = Annotated[str, typer.Argument(help="a ready scene (knee) or the path of a scene .toml")]
PresetName = Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")]
Cycles = Annotated[
    list[Path] | None, typer.Option(help="cycle files (CSV) of the reference motion; the built-in one if left out")
]
MoreCycles = Annotated[list[Path] | None, typer.Argument(help="further cycle files")]
Out = Annotated[Path | None, typer.Option(help="folder of all results; results/SCENE-PRESET if left out")]


def _project(scene: str, preset: str, out: Path | None) -> Project:
    return Project.open(scene, preset, out)


@contextmanager
def _bars() -> Iterator[Callable[[str, float, float, str], None]]:
    """A callback (what, done, all, remark) that keeps one progress bar for each `what`."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}"),
    )
    with Progress(*columns, console=console) as progress:
        tasks: dict[str, int] = {}

        def update(what: str, done: float, total: float, remark: str = "") -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=round(total), remark=remark)
            progress.update(tasks[what], completed=round(done), total=round(total), remark=remark)  # type: ignore[arg-type]

        try:
            yield update
        except KeyboardInterrupt:
            console.print("interrupted: run the same command again to go on")
            raise


@app.command()
def build(
    scene: SceneName,
    preset: PresetName = "quick",
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    out: Out = None,
) -> None:
    """Sample, train, evaluate and export; run again after an interruption to go on."""
    project = _project(scene, preset, out)
    _sample(project, [*(cycles or []), *(more_cycles or [])])
    _train(project)
    _evaluate(project)
    _export(project)


@app.command()
def sample(
    scene: SceneName,
    preset: PresetName = "quick",
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    out: Out = None,
) -> None:
    """Draw samples of the elastic foundation in domains D1 to D7."""
    _sample(_project(scene, preset, out), [*(cycles or []), *(more_cycles or [])])


@app.command()
def train(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Train the preset's networks on the samples."""
    _train(_project(scene, preset, out))


@app.command()
def evaluate(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Print and write the errors per domain and the speed on an unseen walking sequence."""
    _evaluate(_project(scene, preset, out))


@app.command()
def export(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Write CasADi files, and C source with an example."""
    _export(_project(scene, preset, out))


@app.command()
def info(surrogate: Annotated[str, typer.Argument(help="a ready surrogate (knee) or the path of a .h5 file")]) -> None:
    """Say what a surrogate was trained on and how wrong it is."""
    console.print(str(load_surrogate(surrogate).info()), highlight=False, markup=False, soft_wrap=True)


@app.command()
def show(
    scene: SceneName,
    pose: Annotated[str | None, typer.Option(help="tx,ty,tz,rx,ry,rz in mm and rad; just touching if left out")] = None,
    poses: Annotated[Path | None, typer.Option(help="CSV of poses (tx ... rz): a strip of small pictures")] = None,
    out: Annotated[Path | None, typer.Option(help="picture file; SCENE.png if left out")] = None,
) -> None:
    """Draw the pressure on the fixed surface and the moving surface in section."""
    model = ElasticFoundation(load_scene(scene))
    if pose is not None and poses is not None:
        raise ValueError("got both --pose and --poses, expected one of them")
    if poses is not None:
        shown = read_poses(poses)
    else:
        shown = np.array([neutral_pose(model) if pose is None else _numbers(pose)])
    path = Path(f"{model.scene.name}.png") if out is None else out
    draw_contact(model, shown, path)
    for line in surface_fits(model):
        console.print(line, highlight=False)
    console.print(f"picture in {path}", highlight=False)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--pose is {text!r}, expected six numbers tx,ty,tz,rx,ry,rz") from None


def _sample(project: Project, cycle_files: list[Path]) -> None:
    with _bars() as update:
        samples, report = pipeline.sample(project, cycle_files, lambda done, total: update("samples", done, total, ""))
    if report is not None:
        console.print(str(report), highlight=False)
    console.print(f"{len(samples)} samples in {project.samples_path}", highlight=False)


def _train(project: Project) -> None:
    with _bars() as update:
        paths = pipeline.train(project, update)
    for path in paths:
        console.print(f"surrogate in {path}", highlight=False)


def _evaluate(project: Project) -> None:
    path = pipeline.evaluate(project)
    for table in evaluation_tables(read_evaluation(path)):
        console.print(table)
    console.print(f"evaluation in {path}", highlight=False)


def _export(project: Project) -> None:
    for path in pipeline.export(project):
        console.print(f"exported {path}", highlight=False)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    try:
        app()
    except (ValueError, OSError, ImportError) as error:
        sys.exit(f"casadi-contact: {error}")


if __name__ == "__main__":
    main()
