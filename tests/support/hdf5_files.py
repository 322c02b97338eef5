"""HDF5 files changed by somebody who knows how they are sealed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from casadi_contact.core.files.containers import BLOCK, sealed


@contextmanager
def resealed(path: Path) -> Iterator[h5py.File]:
    """A sealed file opened to change, and sealed again with the digest of its new bytes."""
    bare = path.with_suffix(".bare")
    bare.write_bytes(path.read_bytes()[BLOCK:])
    with h5py.File(bare, "a") as file:
        yield file
    path.write_bytes(sealed(bare.read_bytes()))
    bare.unlink()
