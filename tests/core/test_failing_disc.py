"""A disc that is all but full, a read-only folder, killed writers: one line each, nothing lost, and it goes on."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from casadi_contact.networks.training.fit import fit
from casadi_contact.samples.samples import read_samples
from tests.support.smooth_samples import FIXED, smooth
from tests.support.two_spheres import draw


def others_may_read(path: Path) -> bool:
    """True where another user reaches the file: the writers run as one where the tests run as root."""
    return all(part.stat().st_mode & 0o005 == 0o005 for part in path.resolve().parents)


pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits and rights as POSIX has them")
BEFORE = b"what an earlier run wrote"
KEPT = ("surrogate.h5", "samples.h5", "evaluation.json", "ball.c")


def failing(fault, folder):
    """What every writer said with this fault, and what the process wrote to standard error."""
    command = [sys.executable, "-m", "tests.support.failing_disc", fault, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    return json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module", params=["full", "read-only"])
def failed(request):
    if request.param == "read-only" and os.geteuid() == 0 and not others_may_read(Path(__file__)):
        pytest.skip("only root can read this checkout, and root may write in a read-only folder")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kept in KEPT:
            (folder / kept).write_bytes(BEFORE)
        folder.chmod(0o555 if request.param == "read-only" else 0o755)
        said, stderr = failing(request.param, folder)
        folder.chmod(0o755)
        yield folder, said, stderr


def test_every_writer_says_one_line(failed):
    folder, said, stderr = failed
    assert len(said) == 13
    for name, (kind, text) in said.items():
        assert kind == "OSError", f"{name}: {kind} {text}"
        assert len(text.splitlines()) == 1, f"{name}: {text}"
        assert str(folder) in text, f"{name}: {text}"
        assert "cannot write" in text, f"{name}: {text}"
    assert "Traceback" not in stderr
    assert "Exception ignored" not in stderr


def test_what_was_there_stays_and_nothing_half_written_is_left(failed):
    folder, said, _ = failed
    for kept in KEPT:
        assert (folder / kept).read_bytes() == BEFORE
    left = {path.name for path in folder.rglob("*") if path.is_file()} - set(KEPT)
    # Files smaller than the limit may well be whole.
    assert not [name for name in left if name.startswith(".") or name in said]


def test_drawing_and_fitting_go_on_afterwards_bit_by_bit(failed, tmp_path):
    folder, _, _ = failed
    draw(folder / "drawn.h5")
    draw(tmp_path / "whole.h5")
    assert (folder / "drawn.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    assert len(read_samples(folder / "drawn.h5"))
    resumed, whole = fit(smooth(), FIXED, folder / "fit.npz"), fit(smooth(), FIXED)
    for a, b in zip(resumed.network.weights, whole.network.weights, strict=True):
        np.testing.assert_array_equal(a, b)
