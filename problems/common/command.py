"""How every problem runs from the command line."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import typer

from casadi_contact.core import terminal
from casadi_contact.optimisation.verification.verdict import Verdict
from problems.common.outcome import rows_in_words

RESULTS = Path("results")  # each problem writes into a folder of its own name in it


def new_app() -> typer.Typer:
    """A command whose mistakes `run_command` reports."""
    return terminal.new_app(add_completion=False)


def run_command(app: typer.Typer, name: str) -> NoReturn:
    """Run a problem's command: a user's mistake is one line on stderr and exit status 1, never a traceback."""
    terminal.run_app(app, name.rpartition(".")[2], sys.argv[1:], f"python -m problems.{name}")


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The first that is not solved (2), else the first that differs (3), else the first."""
    return min(verdicts, key=lambda verdict: verdict.exit_code or 4)


def end_with(verdict: Verdict, name: str, out: Path, rows: str = "frames") -> None:
    """End the command with the verdict's exit code, and one line on stderr where rows are not verified; rows: what the
    command calls them."""
    if verdict.exit_code:
        good = verdict.solved if verdict.exit_code == 2 else verdict.verified
        what = "not solved" if verdict.exit_code == 2 else f"solved, but {verdict.doubt}"
        print(f"{name}: {what}: {rows} {rows_in_words(~good & verdict.has_load)}; see {out}", file=sys.stderr)
        raise typer.Exit(verdict.exit_code)
