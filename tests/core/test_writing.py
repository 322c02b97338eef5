"""Files are whole or absent, links are replaced, pipes refused; a folder belongs to one process at a time."""

import os
import signal
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from casadi_contact.cli import pipeline
from casadi_contact.core.files.writing import folder_lock, replacing, write_text

posix = pytest.mark.skipif(os.name != "posix", reason="pipes and permissions as POSIX has them")


@posix
def test_a_pipe_or_folder_is_refused_and_kept(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder"):
        with pytest.raises(OSError, match=name):
            write_text(tmp_path / name, "text")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    assert len(list(tmp_path.iterdir())) == 2


@posix
@pytest.mark.parametrize("before", ["old", None])
def test_a_link_is_replaced_and_what_it_points_to_kept(tmp_path, before):
    old, link = tmp_path / "old", tmp_path / "link"
    if before:
        old.write_text(before)
    link.symlink_to(old)
    write_text(link, "new")
    assert (link.read_text(), link.is_symlink()) == ("new", False)
    assert (old.read_text() if old.exists() else None) == before


@posix
def test_who_may_read_a_file_stays_as_it_was(tmp_path):
    path, mode = tmp_path / "own.txt", 0o444
    write_text(path, "before")
    path.chmod(mode)
    write_text(path, "after")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("after", mode)


def test_a_failed_block_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("before")

    def fail():
        with replacing(path) as temporary:
            temporary.write_bytes(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


HOLD = """
import sys
from pathlib import Path
from casadi_contact.core.files.writing import folder_lock
with folder_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_build_is_refused_while_a_process_holds_the_folder_and_a_killed_one_holds_nothing(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(BlockingIOError, match="in use"):
            pipeline.build("knee", folder=tmp_path)
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
            with pytest.raises(BlockingIOError, match="in use"):
                other.submit(hold).result()
        assert other.submit(hold).result()
