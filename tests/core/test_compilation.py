"""The first evaluation says what it waits for, a second process waits for nothing, and threads for no others."""

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.threads import at_most_threads, in_shares

ROOT = Path(__file__).parents[2]
# A module of the package with a loop that compiles in no time.
MODULE = """
from casadi_contact.core.compilation import njit

@njit()
def doubled(x):
    return 2.0 * x
"""
SCRIPT = """
import casadi_contact
casadi_contact.__path__.append({folder!r})
from casadi_contact.example import doubled
print(doubled(1.0), doubled(1))
"""


def test_a_compilation_is_announced_once_with_its_folder_and_only_where_there_is_one(tmp_path):
    (tmp_path / "example.py").write_text(MODULE)
    script = SCRIPT.format(folder=str(tmp_path))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, second = (
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment)
        for _ in range(2)
    )
    assert first.stdout == second.stdout == "2.0 2.0\n"
    (line,) = first.stderr.splitlines()
    assert line.startswith("casadi_contact: compiling the contact model")
    assert str(tmp_path / "cache") in line
    assert second.stderr == ""


def test_rows_are_shared_among_threads_that_have_work_and_come_back_in_order():
    rows = np.arange(1000)
    with at_most_threads(3):
        parts = in_shares(1000, lambda part: rows[part], rows_of_a_thread=300, multiple=7)
        assert len(in_shares(599, lambda part: rows[part], rows_of_a_thread=300)) == 1, "one thread has enough"
    np.testing.assert_array_equal(np.concatenate(parts), rows)
    assert {len(part) for part in parts[:-1]} == {42}
    assert len(in_shares(1000, lambda part: rows[part])) == 1, "tests run on one thread"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_process_that_is_forked_after_use_evaluates_too():
    model, poses = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20)), np.zeros((40, 6))
    with at_most_threads(2):
        gaps = model.gaps(poses)
        with multiprocessing.get_context("fork").Pool(1) as pool:
            np.testing.assert_array_equal(pool.apply_async(model.gaps, (poses,)).get(60.0), gaps)
