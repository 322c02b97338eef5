"""Arguments and options that several commands share, and how all of them print."""

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.terminal import PlainConsole
from casadi_contact.samples.models import MODELS
from casadi_contact.scenes.loading import ready_scenes
from casadi_contact.surrogate.load import ready_surrogates
from casadi_contact.workflow.presets import PRESETS
from casadi_contact.workflow.project import Project, shipped_surrogates

console = PlainConsole()

SceneOrSurrogate = Annotated[
    str,
    typer.Argument(help="a ready scene, the path of a .toml, or a surrogate: a ready name or the path of a .h5 file"),
]
SceneName = Annotated[str, typer.Argument(help=f"a ready scene ({', '.join(ready_scenes())}) or the path of a .toml")]
DEFAULT_PRESET = "quick"
_HOW_MUCH = f"how much to sample and train: {', '.join(PRESETS)}"
PresetName = Annotated[str, typer.Option(help=_HOW_MUCH)]
PresetOrNone = Annotated[str | None, typer.Option(help=_HOW_MUCH, show_default=DEFAULT_PRESET)]
Cycles = Annotated[
    list[Path] | None, typer.Option(help="cycle files (CSV) of the reference motion; else the built-in one")
]
MoreCycles = Annotated[list[Path] | None, typer.Argument(help="further cycle files")]
Table = Annotated[Path | None, typer.Option(help="a table of samples (CSV) of any contact model, instead of sampling")]
ModelName = Annotated[str, typer.Option(help=f"contact model that samples are evaluated on: {', '.join(MODELS)}")]
SurrogateName = Annotated[str, typer.Argument(help=f"ready surrogate ({', '.join(ready_surrogates())}) or a .h5 file")]
Force = Annotated[bool, typer.Option("--force", help="replace files that exist")]
Out = Annotated[Path | None, typer.Option(help="folder of all results; results/SCENE-PRESET (-TOLERANCE) if left out")]


def say(*lines: object) -> None:
    """Print lines as they are: unwrapped, and without markup."""
    console.print(*map(str, lines), sep="\n", highlight=False, markup=False, soft_wrap=True)


def check_html(out: Path) -> None:
    """Raises ValueError, before long work, for a page that no browser would open by its name."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--out is {out}, expected a page's name, for example {out.with_suffix('.html').name}")


def say_shipped(project: Project, doing: str) -> None:
    """Say that shipped surrogates are taken, if a folder holds no results yet."""
    if not project.has_results and project.surrogate is None and shipped_surrogates(project.scene):
        say(f"nothing built in {project.folder}: {doing} the shipped surrogates")
