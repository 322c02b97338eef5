"""Files of arrays: HDF5 with a digest of its bytes, and .npz.

An HDF5 file of this library begins with a block of 512 bytes that other tools skip (HDF5 calls it a user block):

    casadi_contact sealed HDF5
    sha256 <hex digest of all that follows the block>

The digest is compared before HDF5 parses anything, because HDF5 may crash on damaged bytes.
"""

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4
from zipfile import ZIP_STORED, ZipFile

import h5py
import numpy as np

from casadi_contact.core.files.reading import MOST_DATA, checked_size, one_line
from casadi_contact.core.files.writing import write_bytes

BLOCK = 512
_MAGIC = b"casadi_contact sealed HDF5\n"


@contextmanager
def new_hdf5(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file in memory to fill; it replaces `path` when the block ends without an error. Raises OSError."""
    # In memory, because HDF5 crashes Python where it closes a file on a full disc.
    with h5py.File(uuid4().hex, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    write_bytes(path, sealed(image))


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file of this library to read, from memory; ValueError in one line for damage and for errors inside."""
    checked_size(path, MOST_DATA)
    content = path.read_bytes()
    if not content.startswith(_MAGIC):
        raise ValueError(f"{path} is damaged, or not a file of casadi_contact: build or draw it again")
    if content != sealed(content[BLOCK:]):
        raise ValueError(f"{path} is damaged (its digest does not match): delete and build it, or copy it again")
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            _check(file)
            yield file
    except ValueError as error:
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {one_line(error)}") from None
    except Exception as error:  # h5py, and readers that meet another layout, raise many types
        raise ValueError(f"{path} is damaged ({one_line(error)}): delete and build it, or copy it again") from None


def sealed(image: bytes) -> bytes:
    """HDF5 bytes behind the block with their digest."""
    digest = hashlib.sha256(image).hexdigest().encode()
    return (_MAGIC + b"sha256 " + digest).ljust(BLOCK, b"\n") + image


def _check(group: h5py.Group, left: int = MOST_DATA, depth: int = 8) -> int:
    """Bytes left of the limit after all data sets below a group; raises ValueError for data outside the file."""
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise ValueError(f"{name} is a link, expected data in this file")
        item = group[name]
        if isinstance(item, h5py.Group):
            if depth == 0:
                raise ValueError(f"groups are nested too deep at {name}")
            left = _check(item, left, depth - 1)
        elif isinstance(item, h5py.Dataset):
            if item.is_virtual or item.external:
                raise ValueError(f"data set {name} lies in another file, expected all data in this one")
            left -= item.nbytes if item.shape is not None else 0
        if left < 0:
            raise ValueError(f"data sets have more than {MOST_DATA} bytes: is it the right file?")
    return left


def write_npz(path: Path, **arrays: Any) -> None:
    """Replace `path` by an .npz file of these arrays; raises OSError in one line."""
    memory = io.BytesIO()
    np.savez(memory, **arrays)
    write_bytes(path, memory.getvalue())


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an uncompressed .npz file, never unpickled; raises FileNotFoundError, ValueError for damage."""
    try:
        checked_size(path, MOST_DATA)
        with ZipFile(path) as archive:
            if any(member.compress_type != ZIP_STORED for member in archive.infolist()):
                raise ValueError("it is compressed, expected stored arrays")
        with np.load(path, allow_pickle=False) as file:
            return {name: np.asarray(file[name]) for name in file}
    except (FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:  # damaged bytes lead to errors of many types in zipfile and NumPy
        raise ValueError(f"{path} is damaged ({one_line(error)}): delete it, and run the same again") from None
