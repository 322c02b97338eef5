"""A disc that is all but full, a read-only folder: one line each, nothing lost, and it goes on."""

import json
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import casadi_contact as cc
from casadi_contact.core.files.containers import write_npz
from casadi_contact.core.files.writing import write_text
from casadi_contact.networks.training.fit import fit
from casadi_contact.pictures import charts, page
from casadi_contact.samples.samples import read_samples, write_samples
from casadi_contact.scenes.cycle import write_cycle
from casadi_contact.scenes.opensim import poses_table, write_table
from casadi_contact.scenes.pose_file import write_poses
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.workflow.benchmark.front_file import read_front, write_front
from tests.support.own_contact import SCENE
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.smooth_samples import FIXED, smooth, smooth_samples
from tests.support.two_spheres import draw

resource = pytest.importorskip("resource", reason="limits and rights as POSIX has them")
POSES, TIME_S = random_poses(40), np.arange(40.0)
FRONT = Path(cc.__file__).parent / "workflow" / "benchmark" / "ready" / "knee.csv"
BEFORE = b"what an earlier run wrote"
KEPT = ("surrogate.h5", "samples.h5", "evaluation.json", "ball.c")


def writers():
    """Of every file that the library writes, by its name; what takes long is made beforehand."""
    surrogate, samples, front, picture = (
        random_surrogate(SCENE, "patch"),
        smooth_samples(60),
        read_front(FRONT),
        Figure(),
    )
    picture.subplots().plot(POSES)
    return {
        "samples.h5": lambda path: write_samples(path, samples),
        "drawn.h5": draw,
        "surrogate.h5": surrogate.save,
        "fit.npz": lambda path: fit(smooth(), FIXED, path),
        "motion.npz": lambda path: write_npz(path, poses=POSES),
        "evaluation.json": lambda path: write_text(path, json.dumps(POSES.tolist())),
        "speed_accuracy.csv": lambda path: write_front(path, front),
        "chart.png": lambda path: charts.save(picture, path.parent, path.stem),
        "picture.png": lambda path: page.save_page(picture, path),
        "ball.c": lambda path: cc.export_c(surrogate, path.parent, name="ball"),
        "cycle.csv": lambda path: write_cycle(reference_cycle(), path),
        "poses.csv": lambda path: write_poses(TIME_S, POSES, path),
        "poses.sto": lambda path: write_table(poses_table(TIME_S, POSES, "poses"), path),
    }


@contextmanager
def full(_):
    """No file may be larger than 900 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (900, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextmanager
def read_only(folder):
    """For whom the superuser, who may write anywhere, becomes another user."""
    user = os.geteuid()
    folder.chmod(0o555)
    os.seteuid(user or 65534)
    try:
        yield
    finally:
        os.seteuid(user)
        folder.chmod(0o755)


@pytest.fixture(scope="module", params=[full, read_only])
def failed(request):
    """The folder, and by the name of its file what every writer raised there."""
    made, said = writers(), {}
    with tempfile.TemporaryDirectory() as sound, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kept in KEPT:
            (folder / kept).write_bytes(BEFORE)
        for name, write in made.items():
            write(Path(sound) / name)  # whatever else that takes is there now
        with request.param(folder):
            for name, write in made.items():
                with pytest.raises(OSError, match="cannot write") as error:
                    write(folder / name)
                said[name] = str(error.value)
        yield folder, said


def test_every_writer_says_one_line(failed):
    folder, said = failed
    for name, text in said.items():
        assert len(text.splitlines()) == 1, f"{name}: {text}"
        assert str(folder) in text, f"{name}: {text}"


def test_what_was_there_stays_and_nothing_half_written_is_left(failed):
    folder, said = failed
    for kept in KEPT:
        assert (folder / kept).read_bytes() == BEFORE
    left = {path.name for path in folder.rglob("*") if path.is_file()} - set(KEPT)
    # Files smaller than the limit may well be whole.
    assert not [name for name in left if name.startswith(".") or name in said]


def test_drawing_and_fitting_go_on_afterwards_bit_by_bit(failed, tmp_path):
    folder, _ = failed
    draw(folder / "drawn.h5")
    draw(tmp_path / "whole.h5")
    assert (folder / "drawn.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    assert len(read_samples(folder / "drawn.h5"))
    resumed, whole = fit(smooth(), FIXED, folder / "fit.npz"), fit(smooth(), FIXED)
    for a, b in zip(resumed.network.weights, whole.network.weights, strict=True):
        np.testing.assert_array_equal(a, b)
