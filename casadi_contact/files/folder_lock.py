"""One process at a time in a folder of results.

The lock is the operating system's (`filelock`) and ends with its process: what a killed run leaves behind blocks
nobody. Who holds it stands in a file beside it, for the message alone.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from casadi_contact.files.limits import short
from casadi_contact.files.replacing import replacing

LOCK, HOLDER = ".lock", ".lock.holder"


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold a folder; the same thread may hold it again inside.

    Raises BlockingIOError in one line that names the holder where another process or thread has it, and OSError where
    the folder cannot be written.
    """
    folder = folder.resolve()
    lock = FileLock(folder / LOCK, is_singleton=True)
    if lock.is_locked:
        yield
        return
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise BlockingIOError(
            f"{folder} is in use by {_holder(folder)}: wait until it ends, or choose another folder (--out)"
        ) from None
    except OSError as error:
        raise OSError(f"cannot write in folder {folder}: {error.strerror or error}") from None
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    try:
        # A full disc: the lock holds, only its holder is not named.
        with suppress(OSError), replacing(folder / HOLDER, durable=False) as beside:
            held_by = f"process {os.getpid()} on {socket.gethostname()} since {since} ({command})"
            beside.write_text(held_by, "utf-8", "backslashreplace")  # a path may be no text
        yield
    finally:
        with suppress(OSError):
            (folder / HOLDER).unlink()
        lock.release()


def _holder(folder: Path) -> str:
    try:
        with (folder / HOLDER).open("rb") as file:
            return short(file.read(1000).decode(errors="replace")) or "another process"
    except OSError:
        return "another process"
