"""What stands where a file is to be written: files and links are replaced, everything else is kept."""

import os
import stat

import pytest

from casadi_contact.files import write_text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
@pytest.mark.parametrize("through_a_link", [False, True])
def test_a_pipe_or_device_is_refused_and_kept(tmp_path, through_a_link):
    pipe = path = tmp_path / "pipe"
    os.mkfifo(pipe)
    if through_a_link:
        path = tmp_path / "link"
        path.symlink_to(pipe)
    with pytest.raises(OSError, match=r"cannot write .*: a device or pipe, expected a file's name"):
        write_text(path, "text")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert path.is_symlink() == through_a_link
    assert len(list(tmp_path.iterdir())) == 1 + through_a_link


def test_a_folder_is_refused_and_kept(tmp_path):
    (tmp_path / "page").mkdir()
    with pytest.raises(OSError, match="page: a folder, expected a file's name"):
        write_text(tmp_path / "page", "text")
    assert (tmp_path / "page").is_dir()


@pytest.mark.parametrize("before", ["old", None])
def test_a_link_is_replaced_and_what_it_points_to_kept(tmp_path, before):
    """Whether it points to a file or to nothing."""
    old, link = tmp_path / "old", tmp_path / "link"
    if before:
        old.write_text(before)
    link.symlink_to(old)
    write_text(link, "new")
    assert (link.read_text(), link.is_symlink()) == ("new", False)
    assert (old.read_text() if old.exists() else None) == before


@pytest.mark.skipif(os.name != "posix", reason="only POSIX systems have these modes")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_who_may_read_a_file_stays_as_it_was(tmp_path, mode):
    path = tmp_path / "own.txt"
    write_text(path, "before")
    path.chmod(mode)
    write_text(path, "after")
    assert path.read_text() == "after"
    assert path.stat().st_mode & 0o777 == mode
