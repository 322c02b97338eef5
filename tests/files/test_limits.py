"""Files far larger than any sound one are refused at once, in one line, by all that read them."""

import os

import pytest

from casadi_contact.benchmark.front_file import read_front
from casadi_contact.cluster import cluster_workers
from casadi_contact.dataset import partial_folder
from casadi_contact.sampling.folder import ChunkFolder
from casadi_contact.scenes import load_scene
from casadi_contact.shapes.mesh_files import file_digest

TEBIBYTE = 1 << 40  # of a file with nothing in it: discs and memory hold less


def _as_plan(path):
    folder = partial_folder(path.parent / "samples.h5")
    folder.mkdir()
    (folder / "chunk-000000.npz").touch()
    path.rename(folder / "plan.json")
    ChunkFolder(path.parent / "samples.h5", {"scene": "s"})


def _as_scheduler(path):
    with cluster_workers(str(path)):
        pass


@pytest.mark.parametrize("read", [read_front, file_digest, load_scene, _as_plan, _as_scheduler])
def test_a_tebibyte_is_refused_before_it_is_read(read, tmp_path):
    path = tmp_path / "scene.toml"
    path.touch()
    try:
        os.truncate(path, TEBIBYTE)
    except OSError:
        pytest.skip("this disc holds no sparse files")
    with pytest.raises(ValueError, match=f"has {TEBIBYTE} bytes, expected at most") as error:
        read(path)
    assert "\n" not in str(error.value)
