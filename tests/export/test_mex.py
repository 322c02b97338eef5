"""The MEX file of an exported model, built and run by Octave, gives Python's numbers."""

import shutil
import subprocess

import numpy as np
import pytest

import casadi_contact as cc
from tests.support.agreement import close

pytestmark = pytest.mark.skipif(
    shutil.which("octave-cli") is None or shutil.which("mkoctfile") is None, reason="no Octave with mkoctfile found"
)


def octave(script, folder):
    return subprocess.run(
        ["octave-cli", "--no-init-file", "--quiet", "--eval", script], cwd=folder, capture_output=True, text=True
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mex")
    cc.export_c(cc.load_surrogate("knee"), folder, "knee")
    command = ["mkoctfile", "--mex", "-Wall", "knee_mex.c", "knee.c"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return folder


def test_a_mex_file_gives_the_numbers_of_python(folder):
    knee = cc.load_surrogate("knee")
    spread = (0.1, 0.01, 0.1, 0.002, 0.01, 0.02)
    poses = knee.example_pose() + spread * np.random.default_rng(4).uniform(-1.0, 1.0, (5, 6))
    poses[3] *= 1e-3  # as if given in metres
    poses[4, 2] = np.nan
    np.savetxt(folder / "poses.txt", poses.T, fmt="%.17g")
    names = ("loads", "jacobian", "roots", "validity", "expected", "status")
    script = f"[{', '.join(names)}] = knee_mex(load('poses.txt'));"
    script += "".join(f"printf('%.17g ', {name}(:)); printf('\\n');" for name in names)
    ran = octave(script, folder)
    assert ran.returncode == 0, ran.stderr
    loads, jacobian, roots, validity, expected, status = (
        np.array(line.split(), dtype=float).reshape(5, -1) for line in ran.stdout.strip().splitlines()
    )
    assert status.ravel().tolist() == [0, 0, 0, 1, 2]
    sound = poses[:4]
    values, slopes = knee.jacobian(sound)
    close(loads[:3], values[:3], 11)
    close(jacobian.reshape(5, 6, 7).transpose(0, 2, 1)[:3], slopes[:3], 11)
    close(roots[:4], knee.root_loads(sound)[0], 11)
    close(validity[:4, 0], knee.validity(sound), 11)
    close(expected[:3], knee.expected_error(sound[:3]), 9)
    assert all(np.isnan(rows[4]).all() for rows in (loads, jacobian, roots, validity, expected))


def test_a_matrix_of_another_shape_is_refused(folder):
    ran = octave("knee_mex(zeros(5, 2))", folder)
    assert ran.returncode != 0
    assert "expected one real, full matrix of 6 rows" in ran.stderr
