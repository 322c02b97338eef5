"""A command line run in this process."""

import sys

import pytest


def ended(monkeypatch, main, *arguments):
    """What a command's `main` ends with under these arguments: its exit status, or the line that reports a mistake."""
    monkeypatch.setattr(sys, "argv", ["command", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code
