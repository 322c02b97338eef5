"""A folder that holds networks of another scene is refused before minutes of sampling, and stays as it is."""

import pytest

import casadi_contact as cc
from casadi_contact.workflow.project import Project
from casadi_contact.workflow.samples import sample


def test_nothing_is_drawn_beside_a_surrogate_of_another_scene(tmp_path):
    cc.load_surrogate("knee").save(tmp_path / "patch.h5")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ValueError, match=r"patch\.h5 was trained for another scene than hip as it is now"):
        sample(Project.open("hip", "quick", tmp_path))
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.suffix == ".h5"} == before
    assert not (tmp_path / "motion.npz").exists()
