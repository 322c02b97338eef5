"""No name of a scene leaves the folder that a file is written to."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import casadi_contact as cc
from casadi_contact.files import file_stem

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
BAD = ["../../x", "/etc/x", "..", ".", ".hidden", "a/b", "a\\b", "", " knee", "knee ", "a\nb", "a\x1b[31m", "x" * 101]


@pytest.mark.parametrize("name", BAD)
def test_a_name_that_could_leave_its_folder_is_refused(name):
    with pytest.raises(ValueError, match="cannot name a file") as error:
        file_stem(name)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["knee", "knee-2", "Knie groß", "a.b", "left hip_2"])
def test_ordinary_names_are_taken_as_they_are(name):
    assert file_stem(name) == name


@pytest.mark.parametrize("command", ["show", "build", "export"])
def test_a_scene_file_with_such_a_name_writes_nowhere(command, tmp_path):
    scene, work = tmp_path / "scene.toml", tmp_path / "a" / "b"
    work.mkdir(parents=True)
    scene.write_text(cc.load_scene("sphere_on_plane").to_toml().replace('name = "sphere_on_plane"', 'name = "../../x"'))
    assert "../../x" in scene.read_text()
    before = sorted(tmp_path.rglob("*"))
    run = [sys.executable, "-m", "casadi_contact.cli", command, scene]
    done = subprocess.run(run, capture_output=True, text=True, check=False, cwd=work, env=ENVIRONMENT)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before
