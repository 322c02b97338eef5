"""What stands in a file is shown on the terminal, not obeyed by it."""

import io
import subprocess
import sys
from itertools import count

import pytest
from rich.console import Console
from rich.table import Table

from casadi_contact.core import terminal
from casadi_contact.core.terminal import PlainConsole, progress_bars

EVIL = "\x1b]0;owned\x07\x9b31m[red]\u202eknee[/red]\r"


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_console_obeys_neither_names_nor_markup(is_terminal):
    out = io.StringIO()
    console = PlainConsole(file=out, force_terminal=is_terminal, width=200)
    table = Table(EVIL, title=EVIL)
    table.add_row(EVIL)
    console.print(f"surrogate in {EVIL}", highlight=False)
    console.print(table)
    assert out.getvalue().count("[red]") == 4
    for control in ("\x1b]", "\x07", "\x9b", "\u202e", "\r"):
        assert control not in out.getvalue()


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_table_keeps_every_digit_and_name_however_narrow_the_terminal_is(is_terminal):
    out, table = io.StringIO(), Table("structure", "Fy_med (N)", "Tx (N·mm)", title="Loads")
    table.add_row("two_stage", "0.0943", "18573.25")
    PlainConsole(file=out, force_terminal=is_terminal, width=20).print(table)
    for word in ("structure", "Fy_med", "(N·mm)", "two_stage", "0.0943", "18573.25"):
        assert word in out.getvalue()
    assert "…" not in out.getvalue()


def test_a_hostile_name_in_an_error_is_one_harmless_line():
    command = [sys.executable, "-m", "casadi_contact.cli.main", "info", f"{EVIL}\n.h5"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count(b"\n") <= 2
    assert not {0x1B, 0x07, 0x0D} & set(done.stderr)
    assert b"Traceback" not in done.stderr


def test_a_fit_that_ended_early_shows_the_work_it_took():
    written = io.StringIO()
    with progress_bars(Console(file=written, width=120)) as update:
        update("root", 0.2, 1000.0, "Gflop")
        update("root", 0.4, 0.4, "8-8 RMS 0.1 after 0.4 Gflop, error reached")
    last = written.getvalue().strip().splitlines()[-1]
    assert "1/1" in last
    assert "after 0.4 Gflop" in last
    assert "1000" not in last


def test_a_file_is_told_of_long_work_while_it_lasts(monkeypatch):
    """A build that runs overnight into a log is not silent until its end; each other fit is told in its turn."""
    minutes = count()
    monkeypatch.setattr(terminal.time, "monotonic", lambda: 60.0 * next(minutes))
    written = io.StringIO()
    with progress_bars(Console(file=written, width=40)) as update:
        update("root", 120.0, 1000.0, "Gflop, 20-20-20 RMS 1.2")
        assert "root 120/1000 Gflop, 20-20-20 RMS 1.2" in written.getvalue()
        update("ratios", 5.0, 100.0, "Gflop")
        assert "ratios 5/100 Gflop" in written.getvalue()
