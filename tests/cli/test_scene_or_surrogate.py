"""Commands take a scene or a surrogate: by its ready name, or the path of its file."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.surrogate import load
from casadi_contact.workflow.project import Project, available_surrogates, surrogate_named

READY = Path(load.__file__).parent / "ready"


@pytest.fixture
def mine(tmp_path):
    return Path(shutil.copy(READY / "knee_two_stage.h5", tmp_path / "my.h5"))


def test_a_name_that_is_both_is_the_scene():
    assert surrogate_named("knee") is None
    assert surrogate_named("knee_two_stage").structure == "two_stage"


def test_a_given_surrogate_stands_for_its_scene_and_for_what_was_trained(mine, tmp_path):
    project = Project.open(mine, "quick", tmp_path / "out")
    assert project.scene.digest == cc.load_scene("knee").digest
    assert list(available_surrogates(project)) == ["two_stage"]


def test_export_writes_the_given_surrogate(mine, tmp_path):
    done = CliRunner().invoke(app, ["export", str(mine), "--kernel", "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert [path.name for path in (tmp_path / "out" / "export").iterdir()] == ["two_stage"]
    assert list((tmp_path / "out" / "export" / "two_stage").glob("*.c"))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.h5"):
        Project.open(tmp_path / "none.h5", "quick", tmp_path)
