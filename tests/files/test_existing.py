"""What is no file is told from what is not there."""

import os
import sys

import pytest

import casadi_contact as cc
from casadi_contact.dataset import read_samples
from casadi_contact.files import existing_file
from casadi_contact.motion.load_cycle import read_cycle


def test_a_file_is_its_path_and_a_missing_one_and_a_folder_are_told_apart(tmp_path):
    path = tmp_path / "there.csv"
    path.write_text("")
    assert existing_file(str(path)) == path
    with pytest.raises(FileNotFoundError, match=r"table .*other.csv does not exist"):
        existing_file(tmp_path / "other.csv", "table")
    with pytest.raises(FileNotFoundError, match=r"table .* is a folder, expected a CSV file"):
        existing_file(tmp_path, "table", "a CSV file")


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes are made otherwise there")
@pytest.mark.parametrize("read", [read_cycle, cc.load_surrogate, cc.load_scene, read_samples])
def test_readers_do_not_wait_for_a_pipe_but_say_what_to_do(tmp_path, read):
    path = tmp_path / "pipe.toml"
    os.mkfifo(path)
    with pytest.raises(FileNotFoundError, match=r"is a pipe or a device, expected .*: save it as one first"):
        read(path)
