"""Both simulations of a drop, OpenSim's in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from casadi_contact.core.compiler import shared_library
from casadi_contact.core.conventions import Array
from problems.opensim_drop import by_casadi
from problems.opensim_drop.problem import Drop

_SCRIPT = Path(__file__).with_name("by_opensim.py")
_PATIENCE_S = 600


@dataclass(frozen=True)
class Comparison:
    """Poses (points, 6) [mm, rad] of the same drop, and OpenSim's version."""

    casadi: Array
    opensim: Array
    version: str

    @property
    def difference(self) -> Array:
        """Largest difference of each pose parameter (6) [mm, rad]."""
        return np.abs(self.opensim - self.casadi).max(axis=0)


def compare(drop: Drop) -> Comparison:
    """Simulate twice. Raises ImportError without OpenSim, RuntimeError with the last line of a process that failed,
    and for one that takes longer than 10 minutes."""
    if find_spec("opensim") is None:
        raise ImportError("the drop needs OpenSim: pip install casadi_contact[opensim]")
    poses, version = _by_opensim(drop)
    return Comparison(by_casadi.simulate(drop), poses, version)


def _by_opensim(drop: Drop) -> tuple[Array, str]:
    model = drop.surrogate.exported()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        source = model.c_source("contact").replace('#include "contact.h"', model.header("contact"))
        settings, result = folder / "settings.json", folder / "poses.json"
        settings.write_text(json.dumps(drop.settings()), "utf-8")
        command = [sys.executable, *map(str, (_SCRIPT, shared_library(source), settings, result))]
        try:
            ran = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, cwd=folder)
        except subprocess.TimeoutExpired:
            raise RuntimeError(
                f"OpenSim has not simulated {drop.duration_s:g} s in {_PATIENCE_S} s: shorten --duration-s"
            ) from None
        if ran.returncode:
            said = ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"]
            raise RuntimeError(f"OpenSim's process failed: {said[-1]}")
        answer = json.loads(result.read_text("utf-8"))
    return np.array(answer["poses"]), answer["opensim"]
