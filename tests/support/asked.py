"""What pose estimation asks about a cycle before it solves anything."""

import sys

from casadi_contact.scenes.load_cycle import write_cycle
from problems.pose_estimation import __main__, estimate
from tests.support.command import ended


def asked_before_solving(cycle, name, folder, monkeypatch, capsys):
    """Standard error of the command, as it stands when the solution would begin."""
    write_cycle(cycle, folder / f"{name}.csv")
    asked = []
    monkeypatch.setattr(estimate, "solve_and_complete", lambda *_: asked.append(capsys.readouterr().err) or sys.exit(7))
    assert ended(monkeypatch, __main__.main, "--cycle", folder / f"{name}.csv", "--out", folder) == 7
    return asked[0]
