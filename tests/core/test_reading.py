"""Files that anyone may have written: exact round trips, nothing that runs, one line for what is refused."""

import os

import h5py
import numpy as np
import pytest

from casadi_contact.core.files.containers import new_hdf5, open_hdf5, read_npz, write_npz
from casadi_contact.core.files.reading import existing_file, finite_number, toml_tables
from tests.support.shared_data import resealed


class Evil:
    """Runs when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("/tmp/unpickled-by-casadi-contact",)


def test_arrays_are_read_back_bit_by_bit(tmp_path):
    arrays = {"poses": np.arange(12.0).reshape(2, 6), "names": np.array(["tx", "é"]), "time": np.array(1.5)}
    write_npz(tmp_path / "a.npz", **arrays)
    back = read_npz(tmp_path / "a.npz")
    assert back.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: np.savez(path, poses=np.array([Evil()], dtype=object)),
        lambda path: np.savez_compressed(path, poses=np.zeros(1 << 24)),
        lambda path: path.write_text("poses"),
    ],
    ids=["pickle", "compressed", "text"],
)
def test_an_npz_that_is_pickled_packed_or_none_is_refused(harm, tmp_path):
    harm(tmp_path / "a.npz")
    with pytest.raises(ValueError, match="damaged") as error:
        read_npz(tmp_path / "a.npz")
    assert len(str(error.value).splitlines()) == 1
    assert not os.path.exists("/tmp/unpickled-by-casadi-contact")


@pytest.fixture
def saved(tmp_path):
    with new_hdf5(tmp_path / "a.h5") as file:
        file["x"] = np.arange(1000.0)
    return tmp_path / "a.h5"


def read(path):
    with open_hdf5(path) as file:
        return file["x"][()]


def test_no_changed_byte_of_a_sealed_file_reaches_hdf5(saved):
    np.testing.assert_array_equal(read(saved), np.arange(1000.0))
    whole = saved.read_bytes()
    for place in range(0, len(whole), len(whole) // 40):
        saved.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
        with pytest.raises(ValueError, match="damaged"):
            read(saved)


def virtual(file):
    layout = h5py.VirtualLayout((8,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (8,))
    file.create_virtual_dataset("y", layout)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda file: file.create_dataset("y", (4096,), "u1", external=[("/etc/passwd", 0, 4096)]), "another"),
        (virtual, "another"),
        (lambda file: file.__setitem__("extra", h5py.ExternalLink("/etc/passwd", "/")), "link"),
        (lambda file: file.__setitem__("group/again", file["/"]), "deep"),
        (lambda file: file.create_dataset("y", (1 << 40,), "f8", chunks=(1 << 20,)), "bytes"),
    ],
    ids=["outside", "virtual", "link", "circular", "eight terabytes"],
)
def test_hdf5_that_reaches_outside_its_file_or_has_no_end_is_refused(saved, change, word):
    with resealed(saved) as file:
        change(file)
    with pytest.raises(ValueError, match=word):
        read(saved)


@pytest.mark.parametrize("text", ["1_000", "٣", "nan", "1e999", "1,5", ""])
def test_only_finite_numbers_are_numbers(text):
    with pytest.raises(ValueError, match="here"):
        finite_number(text, "here")
    assert finite_number("-1.5e3", "here") == -1500.0


@pytest.mark.parametrize("text", ["a = ", "x = " + "[" * 5000, "a" * (1 << 21)])
def test_toml_that_is_none_too_deep_or_too_long_is_one_line(text):
    with pytest.raises(ValueError, match="scene") as error:
        toml_tables(text, "scene")
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_a_missing_file_a_folder_and_a_pipe_are_told_apart(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, word in ((tmp_path / "none", "exist"), (tmp_path, "folder"), (tmp_path / "pipe", "pipe")):
        with pytest.raises(FileNotFoundError, match=word):
            existing_file(path)
    with pytest.raises(ValueError, match="UTF-8"):
        existing_file(tmp_path / "walk\udcff.csv")
