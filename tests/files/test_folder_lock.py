"""A folder of results belongs to one process at a time; a killed one leaves nothing that blocks."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import pytest

from casadi_contact import pipeline
from casadi_contact.cli import main
from casadi_contact.files import folder_lock

HOLD = """
import sys
from pathlib import Path
from casadi_contact.files import folder_lock
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


@pytest.mark.parametrize("command", ["build", "sample", "train", "calibrate", "evaluate", "export", "chart"])
def test_a_second_command_in_the_folder_ends_with_one_line_that_names_the_first(command, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["casadi-contact", command, "knee", "--out", str(tmp_path)])
    with held_elsewhere(tmp_path) as process, pytest.raises(SystemExit) as ended:
        main()
    said = str(ended.value)
    assert len(said.splitlines()) == 1
    assert str(tmp_path) in said
    assert f"process {process.pid} on " in said


def test_a_second_build_from_python_is_refused_too(tmp_path):
    with held_elsewhere(tmp_path), pytest.raises(BlockingIOError, match="in use by process"):
        pipeline.build("knee", folder=tmp_path)


def test_a_killed_process_holds_nothing(tmp_path):
    with held_elsewhere(tmp_path) as process:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with folder_lock(tmp_path):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_links_in_place_of_the_files_of_a_lock_lead_to_nothing_that_is_changed(tmp_path):
    (tmp_path / "results").mkdir()
    for name in (".lock", ".lock.holder"):
        mine = tmp_path / "mine"
        mine.write_text("mine")
        link = tmp_path / "results" / name
        link.symlink_to(mine)
        with suppress(OSError), folder_lock(tmp_path / "results"):
            pass
        link.unlink(missing_ok=True)
        assert mine.read_text() == "mine", name


def test_a_command_whose_path_is_no_text_holds_a_folder_and_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["casadi-contact", "--out", os.fsdecode(b"caf\xe9")])
    with folder_lock(tmp_path), ThreadPoolExecutor(1) as other:
        refused = other.submit(folder_lock(tmp_path).__enter__).exception()
    assert isinstance(refused, BlockingIOError)
    assert "(casadi-contact --out caf" in str(refused)


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


def test_a_block_that_fails_lets_the_folder_go(tmp_path):
    with pytest.raises(ZeroDivisionError), folder_lock(tmp_path):
        raise ZeroDivisionError
    with held_elsewhere(tmp_path):
        pass


def test_folders_that_are_not_the_same_do_not_wait_for_each_other(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    with held_elsewhere(tmp_path / "one"), folder_lock(tmp_path / "two"):
        pass
