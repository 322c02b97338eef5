"""Arguments and options that several commands share, and where all of them print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.presets import PRESETS
from casadi_contact.project import Project
from casadi_contact.sampling import MODELS
from casadi_contact.scenes import ready_scenes
from casadi_contact.terminal import PlainConsole

console = PlainConsole()

SceneName = Annotated[str, typer.Argument(help=f"a ready scene ({', '.join(ready_scenes())}) or the path of a .toml")]
PresetName = Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")]
Cycles = Annotated[
    list[Path] | None, typer.Option(help="cycle files (CSV) of the reference motion; the built-in one if left out")
]
MoreCycles = Annotated[list[Path] | None, typer.Argument(help="further cycle files")]
Table = Annotated[
    Path | None, typer.Option(help="a table of samples (CSV, HDF5) of any contact model, instead of sampling")
]
ModelName = Annotated[
    str,
    typer.Option(help=f"contact model that samples are settled and evaluated on: {', '.join(MODELS)} (faster)"),
]
SurrogateName = Annotated[str, typer.Argument(help="a ready surrogate (knee) or the path of a .h5 file")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="address or file of a Dask scheduler whose workers do the work; the cores here if left out"),
]
Out = Annotated[Path | None, typer.Option(help="folder of all results; results/SCENE-PRESET if left out")]


def say_shipped(project: Project, doing: str) -> None:
    """That a folder holds nothing yet, so that the scene's shipped surrogates are taken."""
    if not project.begun:
        console.print(f"nothing built in {project.folder}: {doing} the shipped surrogates", highlight=False)
