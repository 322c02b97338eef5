"""Mutated files: read as they were, or refused in one line; never a crash, a hang or another type of error."""

import zlib

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.samples.samples import read_samples, write_samples
from casadi_contact.samples.table import read_sample_table
from casadi_contact.scenes.cycle import read_cycle, write_cycle
from casadi_contact.scenes.opensim import poses_table, read_opensim_table, write_table
from casadi_contact.scenes.pose_file import read_poses, write_poses
from casadi_contact.scenes.walking import reference_cycle
from tests.support.mesh_files import appended, binary_stl, obj_of_polygons, ply, written
from tests.support.own_contact import SCENE, table_rows, write_csv
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.smooth_samples import smooth_samples

POSES, TIMES = random_poses(12), np.arange(12.0)
WORDS = (b"nan", b"1e999", b"9" * 400, b"-1", b"\x00", b"\xff\xfe", b"[" * 5000, b'"', b"\n", b"../x", b"\xe2\x80\xae")
MUTATIONS = 12
DIGEST = {"surrogate.h5", "samples.h5"}  # a changed file must not be read as another content

CORNERS = 9.0 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def mesh(name, write):
    return name, (lambda path: written(path, write(CORNERS, FACES)), lambda path: len(load_mesh(path, "mm").faces))


READERS = {  # file: how it is made, how it is read and used
    "surrogate.h5": (
        lambda path: random_surrogate(SCENE, "patch").save(path),
        lambda path: cc.load_surrogate(path)(POSES).tolist(),
    ),
    "samples.h5": (
        lambda path: write_samples(path, smooth_samples(60)),
        lambda path: read_samples(path).loads().tolist(),
    ),
    "table.csv": (lambda path: write_csv(path, table_rows(30)), lambda path: len(read_sample_table(path, SCENE))),
    "chunk.npz": (lambda path: write_npz(path, poses=POSES), lambda path: len(read_npz(path))),
    "scene.toml": (
        lambda path: path.write_text(cc.load_scene("knee").to_toml()),
        lambda path: cc.load_scene(path).to_toml(),
    ),
    "cycle.csv": (lambda path: write_cycle(reference_cycle(), path), read_cycle),
    "poses.csv": (lambda path: write_poses(TIMES, POSES, path), read_poses),
    "poses.sto": (lambda path: write_table(poses_table(TIMES, POSES, "poses"), path), read_opensim_table),
    **dict(map(mesh, ("mesh.obj", "mesh.vtp", "mesh.stl", "mesh.ply"), (obj_of_polygons, appended, binary_stl, ply))),
}


def mutated(content, rng):
    """The content after an accident: bits flip, parts are lost or doubled, words are inserted."""
    start = int(rng.integers(len(content)))
    end = start + int(rng.integers(1, 1000))
    return (
        content[:start] + bytes([content[start] ^ 1 << int(rng.integers(8))]) + content[start + 1 :],
        content[:start],
        content[:start] + content[end:],
        content[:end] + content[start:],
        content[:start] + WORDS[int(rng.integers(len(WORDS)))] + content[start:],
    )[int(rng.integers(5))]


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused_in_one_line(name, tmp_path):
    make, read = READERS[name]
    path = tmp_path / name
    make(path)
    sound, expected = path.read_bytes(), read(path)
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    for number in range(MUTATIONS):
        path.write_bytes(mutated(sound, rng))
        got, error = outcome(read, path)
        if error is None:
            assert name not in DIGEST or got == expected, f"mutation {number} is read as something else"
        else:
            assert isinstance(error, ValueError | OSError), f"mutation {number} raises {error!r}"
            assert len(str(error).splitlines()) == 1, f"mutation {number} raises {error!r}"


def outcome(read, path):
    """What reading gives, and the error that it raises."""
    try:
        return read(path), None
    except Exception as error:
        return None, error
