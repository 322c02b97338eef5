"""How every problem runs from the command line."""

from __future__ import annotations

import sys

import typer

from casadi_contact.terminal import printable


def run_command(app: typer.Typer, name: str) -> None:
    """Run a problem's command: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    try:
        app()
    except (ValueError, OSError, ImportError) as error:
        sys.exit(f"{name}: {printable(str(error))}")
