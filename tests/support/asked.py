"""What pose estimation asks about a cycle before it solves anything."""

import sys

import pytest

from casadi_contact.motion.load_cycle import write_cycle
from problems.pose_estimation import __main__, estimate


def asked_before_solving(cycle, name, folder, monkeypatch, capsys):
    """Standard error of the command, as it stands when the solution would begin."""
    write_cycle(cycle, folder / f"{name}.csv")
    asked = []
    monkeypatch.setattr(estimate, "solve_and_complete", lambda *_: asked.append(capsys.readouterr().err) or sys.exit(7))
    monkeypatch.setattr(sys, "argv", ["pose", "--cycle", str(folder / f"{name}.csv"), "--out", str(folder)])
    with pytest.raises(SystemExit, match="7"):
        __main__.main()
    return asked[0]
