"""A folder of results belongs to one process at a time; a killed one leaves nothing that blocks."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from casadi_contact.cli import pipeline
from casadi_contact.core.files.writing import folder_lock

HOLD = """
import sys
from pathlib import Path
from casadi_contact.core.files.writing import folder_lock
with folder_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def held_elsewhere(folder):
    """Another process that holds the folder until the block ends."""
    command = [sys.executable, "-c", HOLD, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.stdin.close()


def test_a_second_build_from_python_is_refused_too(tmp_path):
    with held_elsewhere(tmp_path), pytest.raises(BlockingIOError, match="process"):
        pipeline.build("knee", folder=tmp_path)


def test_a_killed_process_holds_nothing(tmp_path):
    with held_elsewhere(tmp_path) as process:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with folder_lock(tmp_path):
        pass


def test_a_thread_may_hold_a_folder_twice_and_another_thread_not_meanwhile(tmp_path):
    def hold():
        with folder_lock(tmp_path):
            return True

    with ThreadPoolExecutor(1) as other:
        with folder_lock(tmp_path):
            assert hold()
            with pytest.raises(BlockingIOError, match=f"process {os.getpid()} "):
                other.submit(hold).result()
        assert other.submit(hold).result()
