"""Every file that the library writes, written where the disc is full or the folder read-only: a program of its own.

``python -m tests.support.failing_disc FAULT FOLDER`` prints for each writer what it raised, as JSON.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import casadi_contact as cc
from casadi_contact.core.files.containers import write_npz
from casadi_contact.core.files.writing import write_text
from casadi_contact.networks.training.fit import fit
from casadi_contact.pictures import charts as report_figure
from casadi_contact.pictures import page as show_figure
from casadi_contact.samples.samples import write_samples
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.opensim import poses_table, write_table
from casadi_contact.scenes.pose_file import write_poses
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.benchmark.front_file import read_front, write_front
from tests.support.own_contact import SCENE
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.smooth_samples import FIXED, smooth, smooth_samples
from tests.support.two_spheres import draw

POSES = random_poses(40)
FRONT = Path(cc.__file__).parent / "workflow" / "benchmark" / "ready" / "knee.csv"
LIMIT = 900  # bytes a file may have, as on a disc that is all but full


def _picture() -> Figure:
    figure = Figure()
    figure.subplots().plot(POSES)
    return figure


def writers() -> dict[str, Callable[[Path], object]]:
    """By the name of the file; what takes long is made beforehand."""
    surrogate, samples = random_surrogate(SCENE, "patch"), smooth_samples(60)
    front = read_front(FRONT)
    return {
        "samples.h5": lambda path: write_samples(path, samples),
        "drawn.h5": draw,
        "surrogate.h5": surrogate.save,
        "fit.npz": lambda path: fit(smooth(), FIXED, path),
        "motion.npz": lambda path: write_npz(path, poses=POSES),
        "evaluation.json": lambda path: write_text(path, json.dumps(POSES.tolist())),
        "speed_accuracy.csv": lambda path: write_front(path, front),
        "chart.png": lambda path: report_figure.save(_picture(), path.parent, path.stem),
        "picture.png": lambda path: show_figure.save(_picture(), path),
        "ball.c": lambda path: cc.export_c(surrogate, path.parent, name="ball"),
        "cycle.csv": lambda path: write_cycle(reference_cycle(), path),
        "poses.csv": lambda path: write_poses(np.arange(40.0), POSES, path),
        "poses.sto": lambda path: write_table(poses_table(np.arange(40.0), POSES, "poses"), path),
    }


def main(fault: str, folder: Path) -> None:
    """Write each file where it can be, bring the fault about, and try again."""
    made = writers()
    with tempfile.TemporaryDirectory() as sound:
        for name, write in made.items():
            write(Path(sound) / name)
    if fault == "full":
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))
    elif fault == "read-only" and os.geteuid() == 0:
        os.setuid(65534)  # the superuser may write anywhere
    said = {}
    for name, write in made.items():
        try:
            write(folder / name)
            said[name] = ["nothing", ""]
        except Exception as error:
            said[name] = ["OSError" if isinstance(error, OSError) else type(error).__name__, str(error)]
    sys.stdout.write(json.dumps(said))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
