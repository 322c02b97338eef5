"""The command line: ``casadi-contact build | sample | train | evaluate | export | info``, thin over `pipeline`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from casadi_contact import pipeline
from casadi_contact.pipeline import PRESETS, Project
from casadi_contact.report import evaluation_tables, read_evaluation
from casadi_contact.surrogate import load_surrogate

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__, pretty_exceptions_enable=False)
console = Console()

SceneName = Annotated[str, typer.Argument(help="a ready scene (knee) or the path of a scene .toml")]
PresetName = Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")]
Cycles = Annotated[
    list[Path] | None, typer.Option(help="cycle files (CSV) of the reference motion; the built-in one if left out")
]
MoreCycles = Annotated[list[Path] | None, typer.Argument(help="further cycle files")]
Table = Annotated[
    Path | None, typer.Option(help="a table of samples (CSV, HDF5) of any contact model, instead of sampling")
]
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
    table: Table = None,
    out: Out = None,
) -> None:
    """Sample, train, evaluate and export; run again after an interruption to go on."""
    project = _project(scene, preset, out)
    _sample(project, [*(cycles or []), *(more_cycles or [])], table)
    _train(project)
    _evaluate(project)
    _export(project)


@app.command()
def sample(
    scene: SceneName,
    preset: PresetName = "quick",
    cycles: Cycles = None,
    more_cycles: MoreCycles = None,
    table: Table = None,
    out: Out = None,
) -> None:
    """Draw samples of the elastic foundation in domains D1 to D7."""
    _sample(_project(scene, preset, out), [*(cycles or []), *(more_cycles or [])], table)


@app.command()
def train(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Train the preset's networks on the samples."""
    _train(_project(scene, preset, out))


@app.command()
def evaluate(scene: SceneName, preset: PresetName = "quick", out: Out = None) -> None:
    """Print and write the errors per domain and the speed on an unseen walking sequence."""
    _evaluate(_project(scene, preset, out))


@app.command()
def export(
    scene: SceneName,
    preset: PresetName = "quick",
    out: Out = None,
    kernel: Annotated[bool, typer.Option("--kernel", help="the C kernel alone, without the CasADi file")] = False,
) -> None:
    """Write CasADi files, and C kernels without dependencies, with an example."""
    _export(_project(scene, preset, out), kernel_only=kernel)


@app.command()
def info(surrogate: Annotated[str, typer.Argument(help="a ready surrogate (knee) or the path of a .h5 file")]) -> None:
    """Say what a surrogate was trained on and how wrong it is."""
    console.print(str(load_surrogate(surrogate).info()), highlight=False, markup=False, soft_wrap=True)


def _sample(project: Project, cycle_files: list[Path], table: Path | None) -> None:
    if table is not None:
        if cycle_files:
            raise ValueError("got cycle files and a table of samples, expected one of them")
        samples = pipeline.take_table(project, table)
        console.print(f"{len(samples)} samples of {table} in {project.samples_path}", highlight=False)
        return
    with _bars() as update:
        samples, report = pipeline.sample(project, cycle_files, lambda done, total: update("samples", done, total, ""))
    if report is not None:
        console.print(str(report), highlight=False)
    for domain, reason in samples.provenance.get("left_out", {}).items():
        console.print(f"{domain} left out: {reason}", highlight=False)
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


def _export(project: Project, *, kernel_only: bool = False) -> None:
    for path in pipeline.export(project, kernel_only=kernel_only):
        console.print(f"exported {path}", highlight=False)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    try:
        app()
    except (ValueError, OSError) as error:
        sys.exit(f"casadi-contact: {error}")


if __name__ == "__main__":
    main()
