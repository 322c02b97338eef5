"""The command line: ``casadi-contact scene | build | sample | train | ...``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from casadi_contact import __version__
from casadi_contact.cli.arguments import console
from casadi_contact.cli.build import build, calibrate, evaluate, export, sample, train
from casadi_contact.cli.compare import chart, choose, speed
from casadi_contact.cli.convert import cycle
from casadi_contact.cli.cut import cut
from casadi_contact.cli.examples import examples
from casadi_contact.cli.live import page
from casadi_contact.cli.look import info, report, show
from casadi_contact.cli.propose import scene
from casadi_contact.core.terminal import new_app, run_app

app = new_app(help="Surrogate models of deformable joint contact as CasADi functions.", epilog=examples(""))


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"casadi_contact {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and end")
    ] = False,
) -> None:
    """Options that come before a command."""


_PROJECT = (build, sample, train, calibrate, evaluate, export, chart, speed, choose)
for command in (scene, cut, *_PROJECT, info, report, cycle, show, page):
    whole_sentence = " ".join((command.__doc__ or "").split("\n\n")[0].split())  # else cut off in the list of commands
    app.command(epilog=examples(command.__name__), short_help=whole_sentence)(command)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    run_app(app, "casadi-contact", sys.argv[1:] or ["--help"])


if __name__ == "__main__":
    main()
