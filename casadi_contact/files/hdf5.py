"""HDF5 files that carry a digest of their bytes, and are parsed by a process of its own.

A file is a block of 512 bytes, then HDF5; other tools skip the block (HDF5 calls it a user block). In it stand

    casadi_contact sealed HDF5
    sha256 <hex digest of all that follows the block>

so that a damaged byte is found before HDF5 sees it. The digest has no secret: who means harm can make a sound one over
bytes on which HDF5 spins or crashes. So a process of its own with limits on time and memory (`hdf5_copy`) copies what
it finds, and the copy is read; but for files that come with the library, which are trusted as its code is, and those
that this very process wrote. Files without the block (of an older version or another program) are read in the same way.
Links, external storage, virtual data sets and sizes beyond the file's own are refused: nothing outside the file is
touched, and no more memory is taken than it can be worth.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

import h5py

from casadi_contact.files import hdf5_copy
from casadi_contact.files.limits import MOST_DATA, checked_size, one_line
from casadi_contact.files.replacing import write_bytes

BLOCK = 512
_MAGIC = b"casadi_contact sealed HDF5\n"
COPY_CPU_S = 10  # limit of the copying process, and one more for each of:
_COPY_BYTES = 20 << 20
_WAIT = 30.0  # times as long it may take on a busy machine
_written: set[str] = set()  # digests of the files that this process wrote


@contextmanager
def new_hdf5(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to fill, in memory; put in the place of `path` when the block ends well. Raises OSError."""
    # In memory, because HDF5 crashes Python where it cannot write.
    with h5py.File(uuid4().hex, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    write_bytes(path, sealed(image))
    _written.add(_digest(image))


@contextmanager
def open_hdf5(path: Path, *, trusted: bool = False) -> Iterator[h5py.File]:
    """A checked HDF5 file to read, from memory. trusted: it comes with the library; any other is copied first, by a
    process with a limit of its time.

    Raises FileNotFoundError, and ValueError in one line for a damaged or hostile file: also for what a reader's block
    raises over a layout that it did not expect.
    """
    checked_size(path, MOST_DATA)
    content = path.read_bytes()
    image, is_sealed = content[BLOCK:], content.startswith(_MAGIC)
    if is_sealed and content != sealed(image):
        raise ValueError(f"{path} is damaged (its digest does not match): delete and build it, or copy it again")
    if not (is_sealed and (trusted or _digest(image) in _written)):
        image = _copied(path, COPY_CPU_S + len(content) // _COPY_BYTES)
    try:
        with h5py.File(h5py.h5f.open_file_image(image), "r") as file:
            hdf5_copy.check(file, len(image))
            yield file
    except hdf5_copy.RefusedError as error:
        raise ValueError(f"{path} is refused: {error}") from None
    except ValueError:
        raise
    except Exception as error:  # h5py, and readers that find another layout, raise many kinds
        raise ValueError(f"{path} is damaged ({one_line(error)}): delete and build it, or copy it again") from None


def sealed(image: bytes) -> bytes:
    """HDF5 bytes behind the block that names their digest."""
    return (_MAGIC + b"sha256 " + _digest(image).encode()).ljust(BLOCK, b"\n") + image


def _digest(image: bytes) -> str:
    return hashlib.sha256(image).hexdigest()


def _copied(path: Path, cpu_s: int) -> bytes:
    """The file's content as a clean HDF5 image, made by another process."""
    command = [sys.executable, "-P", hdf5_copy.__file__, str(path), str(cpu_s)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_WAIT * cpu_s, check=False)
    except subprocess.TimeoutExpired:
        done = None
    if done is not None and done.returncode == 0:
        return done.stdout
    told = done.stderr.decode(errors="replace").strip().splitlines() if done is not None else []
    if done is not None and done.returncode == hdf5_copy.REFUSED and told:
        raise ValueError(f"{path} is {told[-1]}")
    raise ValueError(f"{path} is damaged: HDF5 crashed or did not come to an end within {cpu_s} s")
