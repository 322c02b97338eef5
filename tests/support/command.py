"""Command lines, run in this process or in one of their own."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def ended(monkeypatch, main, *arguments):
    """What a command's `main` ends with under these arguments: its exit status, or the line that reports a mistake."""
    monkeypatch.setattr(sys, "argv", ["command", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


def ran(module, *arguments):
    """What ``python -m module`` comes to in a clone: exit status and what it printed, as text."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
