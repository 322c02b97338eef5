"""The command line: ``casadi-contact scene | build | sample | train | ...``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from casadi_contact import __version__
from casadi_contact.commands.arguments import console
from casadi_contact.commands.build import build, calibrate, evaluate, export, sample, train
from casadi_contact.commands.compare import chart, choose, speed
from casadi_contact.commands.convert import cycle
from casadi_contact.commands.examples import examples
from casadi_contact.commands.live import page
from casadi_contact.commands.look import info, report, show
from casadi_contact.commands.propose import scene
from casadi_contact.files import short
from casadi_contact.terminal import printable

app = typer.Typer(
    help="Surrogate models of deformable joint contact as CasADi functions.",
    epilog=examples(""),
    pretty_exceptions_enable=False,
)


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
for command in (scene, *_PROJECT, info, report, cycle, show, page):
    app.command(epilog=examples(command.__name__))(command)


# An unknown command, option or value; typer does not export it, and where it comes from depends on typer's version.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    arguments = sys.argv[1:] or ["--help"]
    try:
        sys.exit(app(arguments, standalone_mode=False))
    except typer.Abort:
        sys.exit(130)
    except _UsageError as error:
        said = error.format_message()  # type: ignore[attr-defined]
    except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
        said = str(error)
    sys.exit(f"casadi-contact: {printable(short(said, 2000))}")


if __name__ == "__main__":
    main()
