"""The opensim wheel, which must not share a process with casadi's, in its own: ask it about a model file."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.containers import read_npz, write_npz

WHEEL = Path(__file__).with_name("wheel.py")


def run_opensim(*arguments: str) -> str:
    """What Python prints for a script's path and arguments; ImportError without opensim, ValueError where it fails."""
    if find_spec("opensim") is None:
        raise ImportError("this needs the opensim wheel: pip install casadi_contact[opensim]")
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as folder:  # it leaves its log where it runs
        done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        said = " ".join((done.stderr or done.stdout).rpartition("Error: ")[2].split())
        raise ValueError(f"OpenSim cannot take what it was given: {said or f'it ended with {done.returncode}'}")
    return done.stdout


def describe(model: Path) -> dict[str, Any]:
    """An assembly's tables, muscles' curves, wraps, frames and losses of a model file: see `wheel`."""
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as folder:
        reply = Path(folder) / "reply.json"
        run_opensim(str(WHEEL), "describe", str(model.resolve()), str(reply))
        return dict(json.loads(reply.read_text("utf-8")))


def measure(
    model: str | Path,
    coordinates: Sequence[str],
    values: Array,
    paths: Sequence[str],
    bodies: Sequence[str] = (),
    *,
    arms: bool = False,
) -> dict[str, np.ndarray]:
    """Lengths (n, p) [m] of paths, the path points they wrap between (n, p, 2), moment arms (n, p, c) if asked for, and
    transforms (n, b, 3, 4) of bodies in the ground, at coordinates (n, c) [m, rad]."""
    with tempfile.TemporaryDirectory(prefix="casadi_contact_") as folder:
        request, reply = Path(folder) / "request.npz", Path(folder) / "reply.npz"
        named = {"coordinates": coordinates, "paths": paths, "bodies": bodies}
        texts = {key: np.array(names, dtype=str) for key, names in named.items()}
        write_npz(request, values=values, arms=arms, **texts)
        run_opensim(str(WHEEL), "measure", str(Path(model).resolve()), str(request), str(reply))
        return read_npz(reply)
