"""Files of tests: measured data that may be absent, measured results of the documentation, changed HDF5 files."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import pytest

from casadi_contact.core.files.containers import BLOCK, sealed


def shared_file(name: str) -> Path:
    """A file of the shared data folder ($CASADI_CONTACT_SHARED or ../shared); skips the test without it."""
    folder = Path(os.environ.get("CASADI_CONTACT_SHARED", Path(__file__).parents[3] / "shared"))
    path = folder / name
    if not path.is_file():
        pytest.skip(f"measured data {name} is not here: set CASADI_CONTACT_SHARED to the folder that holds it")
    return path


RESULTS = Path(__file__).parents[2] / "docs" / "results" / "data"
SPEED_ACCURACY = RESULTS / "speed_accuracy.csv"


@contextmanager
def resealed(path: Path) -> Iterator[h5py.File]:
    """A sealed file opened to change, and sealed again with the digest of its new bytes."""
    bare = path.with_suffix(".bare")
    bare.write_bytes(path.read_bytes()[BLOCK:])
    with h5py.File(bare, "a") as file:
        yield file
    path.write_bytes(sealed(bare.read_bytes()))
    bare.unlink()
