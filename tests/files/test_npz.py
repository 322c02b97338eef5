"""Arrays in .npz files: exact round trips, and no pickle, no bomb, no claim beyond the file's size."""

import io
import os
import tracemalloc
import zipfile

import numpy as np
import pytest

from casadi_contact.files import read_npz, write_npz
from casadi_contact.project import Project, read_motion
from casadi_contact.scenes import load_scene

MOST_MEMORY = 32 << 20


class Evil:
    """Runs when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("/tmp/unpickled-by-casadi-contact",)


def with_pickle(path):
    np.savez(path, poses=np.array([Evil()], dtype=object))


def with_zeros_packed(path):
    np.savez_compressed(path, poses=np.zeros(1 << 24))


def with_a_claim_of_terabytes(path):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("poses.npy", stream.getvalue() + bytes(64))


def with_one_member_many_times(path):
    """Overlapping members: the directory names one array a thousand times."""
    array = io.BytesIO()
    np.save(array, np.zeros(1 << 15))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("poses.npy", array.getvalue())
        first = archive.filelist[0]
        for k in range(1000):
            again = zipfile.ZipInfo(f"poses{k}.npy")
            for name in ("header_offset", "CRC", "file_size", "compress_size"):
                setattr(again, name, getattr(first, name))
            archive.filelist.append(again)


def with_text(path):
    path.write_text("poses")


HARM = (with_pickle, with_zeros_packed, with_a_claim_of_terabytes, with_one_member_many_times, with_text)


def test_what_is_written_is_read_back(tmp_path):
    arrays = {"poses": np.arange(12.0).reshape(2, 6), "names": np.array(["tx", "é"]), "time": np.array(1.5)}
    write_npz(tmp_path / "a.npz", **arrays)
    back = read_npz(tmp_path / "a.npz")
    assert back.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype
    with pytest.raises(FileNotFoundError):
        read_npz(tmp_path / "none.npz")


@pytest.mark.parametrize("harm", HARM, ids=lambda harm: harm.__name__)
def test_a_file(harm, tmp_path):
    path = tmp_path / "motion.npz"
    harm(path)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="is damaged") as error:
            read_npz(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
    assert len(str(error.value).splitlines()) == 1
    assert not os.path.exists("/tmp/unpickled-by-casadi-contact")
    with pytest.raises(ValueError, match=r"motion\.npz is damaged .* remove it and sample again"):
        read_motion(Project(load_scene("knee"), "quick", tmp_path))
