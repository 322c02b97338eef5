"""What stands in a file is shown on the terminal, not obeyed by it."""

import io
import subprocess
import sys

import pytest
from rich.table import Table

from casadi_contact.terminal import PlainConsole, printable

EVIL = "\x1b]0;owned\x07\x9b31m[red]\u202eknee[/red]\r"


def test_controls_are_written_out_and_plain_text_stays():
    assert printable(EVIL) == r"\x1b]0;owned\x07\x9b31m[red]\u202eknee[/red]\r"
    assert printable("Fy [N·mm] ± 3°\nµ") == "Fy [N·mm] ± 3°\nµ"


@pytest.mark.parametrize("terminal", [True, False])
def test_a_console_obeys_neither_names_nor_markup(terminal):
    out = io.StringIO()
    console = PlainConsole(file=out, force_terminal=terminal, width=200)
    table = Table(title=EVIL)
    table.add_column(EVIL)
    table.add_row(EVIL)
    console.print(f"surrogate in {EVIL}", highlight=False)
    console.print(table)
    assert out.getvalue().count("[red]") == 4
    for control in ("\x1b]", "\x07", "\x9b", "\u202e", "\r"):
        assert control not in out.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_table_keeps_every_digit_and_name_however_narrow_the_terminal_is(terminal):
    out = io.StringIO()
    table = Table(title="Loads")
    for column in ("structure", "Fy_med (N)", "Tx (N·mm)"):
        table.add_column(column)
    table.add_row("two_stage", "0.0943", "18573.25")
    PlainConsole(file=out, force_terminal=terminal, width=20).print(table)
    for word in ("structure", "Fy_med", "(N·mm)", "two_stage", "0.0943", "18573.25"):
        assert word in out.getvalue()
    assert "…" not in out.getvalue()


def test_a_hostile_name_in_an_error_is_one_harmless_line():
    command = [sys.executable, "-m", "casadi_contact.cli", "info", f"{EVIL}\n.h5"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count(b"\n") <= 2
    assert not {0x1B, 0x07, 0x0D} & set(done.stderr)
    assert b"Traceback" not in done.stderr
