"""The terminal: text shown literally, progress bars, and how every command line of the project runs and ends."""

import io
import sys
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import ceil
from pathlib import Path
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from casadi_contact.core.files.reading import finite_number, short
from casadi_contact.core.interrupts import (
    INTERRUPTED,
    is_interrupt,
    remember_interrupts,
    terminated_as_interrupted,
    was_interrupted,
)

# typer does not export click's UsageError (an unknown command, option or value).
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def printable(text: str) -> str:
    r"""Text with every control character written out, as in \x1b; new lines stay."""
    controls = ("Cc", "Cf", "Cs", "Zl", "Zp")
    return "".join(c if c == "\n" or unicodedata.category(c) not in controls else repr(c)[1:-1] for c in text)


class PlainConsole(Console):
    """A rich console that shows names and paths literally: no markup, no emoji codes, no escape sequences. Columns of
    tables are as wide as their longest words, so that rich never cuts numbers off."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich's own."""
        for column in (column for table in objects if isinstance(table, Table) for column in table.columns):
            words = (column.header, *column.cells)
            column.min_width = max(Measurement.get(self, self.options, word).minimum for word in words)
            options["crop"] = False
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """The text without markup of its own."""
        return super().render_str(printable(text), **{**options, "markup": False, "emoji": False})


@contextmanager
def progress_bars(
    console: Console, *, cure: str = "run the same command again to go on"
) -> Iterator[Callable[[str, float, float, str], None]]:
    """A callback (what, done, all, remark) that keeps one progress bar for each `what`; where the output is a file, a
    line each minute. cure: advice to who interrupts the work."""
    what, remark = (TextColumn(text, markup=False) for text in ("{task.description}", "{task.fields[remark]}"))
    columns = (what, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(), remark)
    with terminated_as_interrupted(), Progress(*columns, console=console) as progress:
        tasks: dict[str, int] = {}
        printed_s = time.monotonic()

        def update(what: str, done: float, total: float, remark: str = "") -> None:
            nonlocal printed_s
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=ceil(total), remark=remark)
            progress.update(tasks[what], completed=ceil(done), total=ceil(total), remark=remark)  # type: ignore[arg-type]
            if not console.is_terminal and time.monotonic() - printed_s >= 60.0:
                printed_s = time.monotonic()
                console.print(f"{what} {ceil(done)}/{ceil(total)} {remark}".rstrip(), highlight=False, soft_wrap=True)

        try:
            yield update
        except (KeyboardInterrupt, SystemError) as error:
            if is_interrupt(error):
                console.print(f"interrupted: {cure}")
            raise


def numbers(text: str, option: str, expected: str = "finite numbers separated by commas") -> list[float]:
    """The numbers in an option's text; raises ValueError naming the option and what is expected."""
    try:
        return [finite_number(part.strip(), option) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--{option} is {text!r}, expected {expected}") from None


def new_app(**settings: Any) -> typer.Typer:
    """A command line whose help shows text literally ([mm] is no markup), for `run_app`."""
    return typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, **settings)


def run_app(app: typer.Typer, name: str, arguments: Sequence[str], prog_name: str | None = None) -> NoReturn:
    """Run and end with an exit status: a user's mistake is one line on stderr, after `name`, and status 1, or 2 for an
    unknown command or option. prog_name: in its help."""
    remember_interrupts()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal without ² or · must not end the program
    try:
        sys.exit(app(arguments, prog_name=prog_name, standalone_mode=False) or 0)
    except (typer.Abort, SystemError) as error:
        if isinstance(error, SystemError) and not is_interrupt(error):
            raise
        sys.exit(INTERRUPTED)
    except _UsageError as error:
        print(f"{name}: {printable(error.format_message())}", file=sys.stderr)  # type: ignore[attr-defined]
        sys.exit(2)
    except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
        if was_interrupted():  # in C++ that calls Python, Ctrl-C becomes an error like any other
            sys.exit(INTERRUPTED)
        message = str(error) or type(error).__name__
    sys.exit(f"{name}: {printable(short(message, 2000))}")


def run_program(main: Callable[..., None]) -> NoReturn:
    """Run a program such as ``python -m problems.wear``: the options are the parameters of its function, the help is
    its docstring. Ends like `run_app`."""
    app = new_app(add_completion=False)
    app.command()(main)
    spec = main.__globals__.get("__spec__")
    module = spec.name.removesuffix(".__main__") if spec else Path(sys.argv[0]).stem
    run_app(app, module.rpartition(".")[2], sys.argv[1:], f"python -m {module}")
