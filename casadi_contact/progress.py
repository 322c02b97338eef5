"""Progress bars on the terminal for long work."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import ceil

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from casadi_contact.interrupts import is_interrupt, terminated_as_interrupted

_BETWEEN_LINES_S = 60.0  # where nobody watches
_GO_ON = "run the same command again to go on"


@contextmanager
def progress_bars(console: Console, *, cure: str = _GO_ON) -> Iterator[Callable[[str, float, float, str], None]]:
    """A callback (what, done, all, remark) that keeps one progress bar for each `what`; in a file, which shows bars at
    the end alone, a line each minute. cure: what to say to who interrupts it."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}", markup=False),
    )
    with terminated_as_interrupted(), Progress(*columns, console=console) as progress:
        tasks: dict[str, int] = {}
        told_s = time.monotonic()

        def update(what: str, done: float, total: float, remark: str = "") -> None:
            nonlocal told_s
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=ceil(total), remark=remark)
            progress.update(tasks[what], completed=ceil(done), total=ceil(total), remark=remark)  # type: ignore[arg-type]
            if not console.is_terminal and time.monotonic() - told_s >= _BETWEEN_LINES_S:
                told_s = time.monotonic()
                console.print(f"{what} {ceil(done)}/{ceil(total)} {remark}".rstrip(), highlight=False, soft_wrap=True)

        try:
            yield update
        except (KeyboardInterrupt, SystemError) as error:
            if is_interrupt(error):
                console.print(f"interrupted: {cure}")
            raise
