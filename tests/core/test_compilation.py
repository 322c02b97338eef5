"""The first evaluation says what it waits for, a second process waits for nothing, and threads for no others."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from casadi_contact.core.compilation import threads_for

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


def test_threads_that_have_no_work_do_not_make_others_wait():
    threads = numba.get_num_threads()
    with threads_for(1):
        assert numba.get_num_threads() == 1
    with threads_for(1_000_000):
        assert numba.get_num_threads() == threads
    with pytest.raises(ValueError, match="of the work"), threads_for(0):
        raise ValueError("of the work")
    assert numba.get_num_threads() == threads
