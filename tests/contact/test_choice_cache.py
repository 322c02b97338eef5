"""The choice of a contact model is made once for a scene, and made again where what is kept is not as written."""

import json
import os

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import choice


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def tests_run(monkeypatch):
    """The scenes that a convergence test ran for."""
    ran = []

    def counted(choose):
        def chosen(scene, **options):
            ran.append(scene)
            return choose(scene, **options)

        return chosen

    kinds = {shape: kind._replace(chosen=counted(kind.chosen)) for shape, kind in choice._KINDS.items()}
    monkeypatch.setattr(choice, "_KINDS", kinds)
    return ran


@pytest.mark.parametrize("name", ["sphere_on_plane", "glenohumeral"])
def test_a_second_model_of_a_scene_is_the_first_without_a_test(folder, tests_run, name):
    first, again = (cc.foundation(name, compiled=False) for _ in range(2))
    assert len(tests_run) == 1
    assert (repr(again), again.record) == (repr(first), first.record)
    pose = first.scene.start_pose
    np.testing.assert_array_equal(again.gaps(pose), first.gaps(pose))
    assert len(list(folder.glob("choice-*.json"))) == 1


def test_a_scene_with_other_tolerances_is_tested_itself(folder, tests_run):
    scene = cc.load_scene("hip")
    for tolerance in (5.0, 2.0):
        cc.foundation(scene.with_overrides(Fy=tolerance), compiled=False)
    assert [tested.tolerances["Fy"] for tested in tests_run] == [5.0, 2.0]
    assert len(list(folder.glob("choice-*.json"))) == 2


OF_CELLS = json.dumps({"model": "cubic cells", "cells_mm": [9.0, 9.0]}).encode()


@pytest.mark.parametrize("damage", [lambda content: content[:-20], lambda _: OF_CELLS, lambda _: b"[1, 2]"])
def test_a_file_that_is_not_as_written_is_replaced(folder, tests_run, damage):
    first = cc.foundation("hip", compiled=False)
    (path,) = folder.glob("choice-*.json")
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    again = cc.foundation("hip", compiled=False)
    assert len(tests_run) == 2
    assert again.record == first.record
    assert path.read_bytes() == whole


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
def test_what_another_user_could_have_written_is_not_taken(folder, tests_run):
    first = cc.foundation("hip", compiled=False)
    (path,) = folder.glob("choice-*.json")
    planted = first.record | {"points": 2 * first.record["points"]}
    path.write_bytes(json.dumps(planted).encode())
    assert cc.foundation("hip", compiled=False).record == planted, "what others must not be able to do"
    for private, open_to_all in ((path, 0o666), (folder, 0o777)):
        path.write_bytes(json.dumps(planted).encode())
        before = private.stat().st_mode
        private.chmod(open_to_all)
        assert cc.foundation("hip", compiled=False).record == first.record
        private.chmod(before)


def test_without_a_folder_to_write_in_each_model_is_tested(tests_run, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("CASADI_CONTACT_CACHE", str(tmp_path / "file" / "cache"))
    for _ in range(2):
        cc.foundation("hip", compiled=False)
    assert len(tests_run) == 2
