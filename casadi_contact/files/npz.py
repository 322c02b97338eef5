"""Arrays by name in an .npz file, read without pickles and without taking more memory than the file has bytes."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.files.limits import MOST_DATA, checked_size, one_line
from casadi_contact.files.replacing import write_bytes


def write_npz(path: Path, **arrays: Any) -> None:
    """Put an .npz file of these arrays in the place of `path`; raises OSError in one line."""
    memory = io.BytesIO()  # zipfile leaves a traceback behind where the disc is full
    np.savez(memory, **arrays)
    write_bytes(path, memory.getvalue())


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an uncompressed .npz file; raises FileNotFoundError, or ValueError for damage in one line."""
    try:
        left = checked_size(path, MOST_DATA)
        arrays = {}
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                left -= member.file_size
                if member.compress_type != zipfile.ZIP_STORED or left < 0:
                    raise ValueError(f"{member.filename!r} is compressed or larger than the file")
                arrays[member.filename.removesuffix(".npy")] = _array(archive.read(member))
        return arrays
    except (FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:  # damaged bytes lead to errors of many kinds in zipfile and NumPy
        raise ValueError(f"{path} is damaged ({one_line(error)})") from None


def _array(content: bytes) -> np.ndarray:
    """An .npy file; its header is held against its size before memory is taken."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    read_header = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}[version[0]]
    shape, _, dtype = read_header(stream)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - stream.tell():
        raise ValueError(f"an array of {shape} {dtype} is not what follows")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)
