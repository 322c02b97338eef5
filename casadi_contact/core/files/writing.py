"""Atomic writing: a file is whole or absent, whatever happens to the process, the machine or the disc."""

import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout


def writable_folder(folder: Path) -> None:
    """Make a folder and try to write in it; raises OSError in one line if either fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"-")
    except OSError as error:
        raise OSError(f"cannot write in folder {folder}: {error.strerror or error}") from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path to write to; it replaces `path` when the block ends without an error, else it is removed. The
    content is on disc before the old file goes; that one's permissions are kept. Raises OSError in one line."""
    if path.exists() and not path.is_file():
        kind = "folder" if path.is_dir() else "device or pipe"
        raise OSError(f"cannot write {path}: a {kind}, expected a file's name")
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        if path.exists() and not path.is_symlink():
            with suppress(OSError):  # not every file system has permissions
                shutil.copymode(path, temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise type(error)(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Replace `path` by a file with this content; raises OSError in one line."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Replace `path` by a UTF-8 file with this text; raises OSError in one line."""
    write_bytes(path, content.encode())


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Lock a folder of results for this process, by the operating system: a killed run blocks nobody. The same thread
    may lock it again inside. Raises BlockingIOError where another process or thread has the lock, else OSError."""
    folder = folder.resolve()
    lock = FileLock(folder / ".lock", is_singleton=True)
    if lock.is_locked:
        yield
        return
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise BlockingIOError(f"{folder} is in use by another process: wait, or choose another --out") from None
    except OSError as error:
        raise OSError(f"cannot write in folder {folder}: {error.strerror or error}") from None
    try:
        yield
    finally:
        lock.release()
