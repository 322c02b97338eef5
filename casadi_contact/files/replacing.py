"""Result files that are never half written, in folders known to be writable.

A file is written beside its place, brought to the disc and renamed. What a killed process left beside is removed by
the next one that writes the same file.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_HOST = re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname())


def writable_folder(folder: Path) -> None:
    """Make a folder and try to write in it; raises OSError in one line if either fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"-")
    except OSError as error:
        raise OSError(f"cannot write in folder {folder}: {error.strerror or error}") from None


@contextmanager
def replacing(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends well, else it is removed.

    durable: wait until the disc has it. Who may read and write a file at `path` stays as it was; a link is replaced,
    and what it points to is as it was. Raises OSError in one line, naming `path`, where it cannot be written, and for a
    device, pipe or folder there; `path` is then as it was.
    """
    if path.exists() and not path.is_file():
        kind = "folder" if path.is_dir() else "device or pipe"
        raise OSError(f"cannot write {path}: a {kind}, expected a file's name")
    _clear_leftovers(path.parent, path.name)
    beside = path.with_name(_beside(path.name))
    try:
        yield beside
        if durable:
            _to_disc(beside, os.O_RDWR)
        if path.exists() and not path.is_symlink():
            with suppress(OSError):  # not every file system can do this
                shutil.copymode(path, beside)
        os.replace(beside, path)
        if durable:
            with suppress(OSError):  # not every file system can do this to a folder
                _to_disc(path.parent, os.O_RDONLY)
    except OSError as error:
        raise type(error)(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            beside.unlink()


def write_bytes(path: Path, content: bytes) -> None:
    """Put a file with this content in the place of `path`; raises OSError in one line."""
    with replacing(path) as beside:
        beside.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Put a UTF-8 file with this text in the place of `path`; raises OSError in one line."""
    write_bytes(path, content.encode())


@contextmanager
def scratch_folder(folder: Path, name: str) -> Iterator[Path]:
    """A folder inside `folder`, removed when the block ends, or by the next call where this process is killed."""
    _clear_leftovers(folder, name)
    with tempfile.TemporaryDirectory(dir=folder, prefix=f"{_beside(name)}~") as scratch:
        yield Path(scratch)


def _beside(name: str) -> str:
    return f".{os.getpid()}-{threading.get_ident()}@{_HOST}~{name}"


def _clear_leftovers(folder: Path, name: str) -> None:
    """Remove what processes of this machine that are no more left beside `name`; those of others may be at work."""
    pattern = re.compile(rf"\.(\d+)(?:-\d+)?@{re.escape(_HOST)}~{re.escape(name)}(~.*)?")
    with suppress(OSError):
        for there in os.listdir(folder):
            match = pattern.fullmatch(there)
            if match is None or _is_alive(int(match[1])):
                continue
            if (folder / there).is_dir():
                shutil.rmtree(folder / there, ignore_errors=True)
            else:
                (folder / there).unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    if os.name != "posix":
        return True  # cannot be asked without harm
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def _to_disc(path: Path, flags: int) -> None:
    number = os.open(path, flags)
    try:
        os.fsync(number)
    finally:
        os.close(number)
