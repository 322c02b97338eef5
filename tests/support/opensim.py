"""OpenSim's Python, which must not share a process with CasADi's."""

import subprocess
import sys
from importlib.util import find_spec

import pytest


def by_opensim(code, folder, *arguments):
    """The last line that OpenSim's Python prints, in a process of its own."""
    if find_spec("opensim") is None:
        pytest.skip("opensim is not installed")
    command = [sys.executable, "-c", code, *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.strip().splitlines()[-1]
