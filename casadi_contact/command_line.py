"""How every command line of the project is made, runs and ends."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import typer

from casadi_contact.files import finite_number, short
from casadi_contact.interrupts import INTERRUPTED, is_interrupt, raise_interrupts, was_interrupted
from casadi_contact.terminal import printable

# An unknown command, option or value; typer does not export it, and where it comes from depends on typer's version.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def numbers(text: str, option: str, expected: str = "finite numbers separated by commas") -> list[float]:
    """The numbers that an option's text holds, between commas; ValueError naming the option, and what is expected, for
    what files refuse as numbers too (`finite_number`)."""
    try:
        return [finite_number(part.strip(), option) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--{option} is {text!r}, expected {expected}") from None


def new_app(**settings: Any) -> typer.Typer:
    """A command line whose help shows texts as they are ([mm] is no markup), and whose mistakes `run_app` reports."""
    return typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, **settings)


def run_app(app: typer.Typer, name: str, arguments: Sequence[str], prog_name: str | None = None) -> NoReturn:
    """Run and end with its exit status: a user's mistake is one line on stderr, after name, and 1; never a traceback.

    prog_name: how help names the program; as it was called if left out.
    """
    raise_interrupts()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that knows no ² or · is no reason to end
    try:
        _refuse_empty(arguments)
        sys.exit(app(arguments, prog_name=prog_name, standalone_mode=False) or 0)
    except typer.Abort:
        sys.exit(INTERRUPTED)
    except SystemError as error:
        if not is_interrupt(error):
            raise
        sys.exit(INTERRUPTED)
    except _UsageError as error:
        said = error.format_message()  # type: ignore[attr-defined]
    except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
        if was_interrupted():  # in C++ that calls Python back Ctrl-C becomes an error like any other
            sys.exit(INTERRUPTED)
        said = str(error) or type(error).__name__  # Python's own MemoryError says nothing
    sys.exit(f"{name}: {printable(short(said, 2000))}")


def _refuse_empty(arguments: Sequence[str]) -> None:
    """ValueError naming the option or argument without a value: an empty path would be the folder of now."""
    for before, argument in zip(("", *arguments), arguments, strict=False):
        option, _, value = argument.partition("=")
        if argument == "" or (option.startswith("--") and option != argument and not value):
            named = option or (before if before.startswith("--") else "an argument")
            raise ValueError(f"{named} is empty, expected a value (an option that is left out takes its default)")
