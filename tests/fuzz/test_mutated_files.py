"""Mutated files of every kind: read as they were, or refused in one line; never a crash, a hang or another error.

``pytest tests/fuzz --mutations 2000 --mutation-seed 7`` tries more and others; every file follows from its reader's
name, its number and the seed.
"""

import zlib

import numpy as np
import pytest

from tests.fuzz.readers import READERS

pytest.importorskip("trimesh", reason="reading meshes needs casadi_contact[mesh]")

SLOW_SHARE = 8  # as many fewer files where each costs a process


@pytest.mark.parametrize("name", READERS)
def test_mutated(name, tmp_path, pytestconfig):
    reader, path = READERS[name], tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    reader.make(path)
    sound = path.read_bytes()
    expected = reader.read(path)
    fast = sum(1.0 if not other.slow else 1.0 / SLOW_SHARE for other in READERS.values())
    count = int(np.ceil(pytestconfig.getoption("mutations") / fast / (SLOW_SHARE if reader.slow else 1)))
    refused = 0
    seed = pytestconfig.getoption("mutation_seed")
    for number in range(count):
        path.write_bytes(reader.mutated(sound, np.random.default_rng([zlib.crc32(name.encode()), number, seed])))
        got, error = outcome(reader.read, path)
        if error is None:
            assert not reader.exact or got == expected, f"mutation {number} is read as something else"
            continue
        refused += 1
        assert isinstance(error, ValueError | OSError), f"mutation {number} raises {error!r}"
        assert len(str(error).splitlines()) == 1, f"mutation {number} raises {error!r}, expected one line"
    assert refused or count < 5, "no mutation was refused: are they any?"


def outcome(read, path):
    """What reading gives, and the error that it raises."""
    try:
        return read(path), None
    except Exception as error:
        return None, error
