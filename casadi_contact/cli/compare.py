"""Time against error: ``chart``, ``speed``, ``choose``."""

from __future__ import annotations

from typing import Annotated

import typer

from casadi_contact.cli import pipeline
from casadi_contact.cli.arguments import (
    DEFAULT_PRESET,
    Out,
    PresetName,
    SceneOrSurrogate,
    Scheduler,
    console,
    say_shipped,
)
from casadi_contact.core.terminal import progress_bars
from casadi_contact.core.workers import cluster_workers
from casadi_contact.pictures.report.tables import choice_table, kernel_speed_tables, read_kernel_speed
from casadi_contact.workflow.benchmark.choose import choose as choose_model
from casadi_contact.workflow.benchmark.speed import speed as time_kernels
from casadi_contact.workflow.project import Project


def chart(
    scene: SceneOrSurrogate,
    preset: PresetName = DEFAULT_PRESET,
    peers: Annotated[
        bool, typer.Option("--peers", help="measure the peers too (pip install casadi_contact[peers])")
    ] = False,
    scheduler: Scheduler = None,
    out: Out = None,
) -> None:
    """Train a ladder of sizes, measure speed and accuracy of everything in one run, and draw the charts."""
    project = Project.open(scene, preset, out)
    with cluster_workers(scheduler) as executor, progress_bars(console) as update:
        paths = pipeline.chart(
            project,
            peers=peers,
            update=update,
            tell=lambda what: update("measuring", 0, 1, what),
            executor=executor,
        )
    for path in paths:
        console.print(f"written {path}", highlight=False)


def speed(scene: SceneOrSurrogate, preset: PresetName = DEFAULT_PRESET, out: Out = None) -> None:
    """Time compiled kernels against CasADi graphs, elastic foundations and the machine's limit.

    Where nothing has been built in the folder, the shipped surrogates of the scene are timed.
    """
    project = Project.open(scene, preset, out)
    say_shipped(project, "timing")
    path = time_kernels(project)
    for table in kernel_speed_tables(read_kernel_speed(path)):
        console.print(table)
    console.print(f"times in {path}", highlight=False)


def choose(
    scene: SceneOrSurrogate,
    force_tol: Annotated[float | None, typer.Option(help="RMS error wanted over the forces [N]")] = None,
    torque_tol: Annotated[float | None, typer.Option(help="RMS error wanted over the torques [N·mm]")] = None,
    loads: Annotated[str | None, typer.Option(help="only these, as Fy_med,Fy_lat; all if left out")] = None,
    preset: PresetName = DEFAULT_PRESET,
    out: Out = None,
) -> None:
    """Name the cheapest model of the chart that meets a tolerance, and train it if it is not on disk.

    Where nothing has been built in the folder, the answer comes from the chart shipped for the scene.
    """
    names = None if loads is None else [name.strip() for name in loads.split(",")]
    with progress_bars(console) as update:
        choice = choose_model(
            scene,
            force_tolerance_n=force_tol,
            torque_tolerance_nmm=torque_tol,
            loads=names,
            preset=preset,
            folder=out,
            update=update,
        )
    console.print(choice_table(choice))
    console.print(choice.measured, highlight=False, markup=False, soft_wrap=True)
    console.print(f"in Python: {choice.python}", highlight=False, soft_wrap=True)
