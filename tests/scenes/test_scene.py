"""Scenes: readable, checked, and the same after a round trip."""

import pytest

import casadi_contact as cc
from casadi_contact.scenes.loading import ready_scenes
from casadi_contact.scenes.scene import Scene


@pytest.mark.parametrize("name", ready_scenes())
def test_every_ready_scene_survives_its_own_text(name):
    scene = cc.load_scene(name)
    again = Scene.from_toml(scene.to_toml())
    assert again == scene
    assert again.digest == scene.digest


def test_keywords_replace_single_parameters_and_change_the_digest():
    scene = cc.load_scene("sphere_on_plane", radius=20.0, law="log", fine=(30, 20))
    assert scene.geometry["radius"] == 20.0
    assert scene.material.law == "log"
    assert scene.grids["fine"] == (30, 20)
    assert scene.digest != cc.load_scene("sphere_on_plane").digest


def test_the_digest_names_the_loads_and_not_how_precisely_they_are_needed():
    knee = cc.load_scene("knee")
    finer = knee.with_tolerances(Fy_med=0.01)
    assert finer.digest == knee.digest
    assert finer != knee


def test_the_digest_does_not_tell_how_much_of_a_sampling_plan_may_be_lost():
    """In a scene with other settings of the sampling, and in one without any."""
    for scene in (cc.load_scene("knee"), cc.load_scene("sphere_on_plane")):
        lenient = Scene.from_tables({**scene.tables, "sampling": {**scene.sampling, "most_dropped": 0.6}})
        other = Scene.from_tables({**scene.tables, "sampling": {**scene.sampling, "seed": 1}})
        assert lenient.digest == scene.digest != other.digest


def test_a_scene_file_can_be_copied_edited_and_loaded(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(cc.load_scene("knee").to_toml().replace("youngs_modulus = 463.0", "youngs_modulus = 700.0"))
    assert cc.load_scene(path).material.youngs_modulus == 700.0


def test_one_side_of_a_knee_can_have_its_own_values():
    text = cc.load_scene("knee").to_toml()
    own = "[geometry]\nmed = { frontal_radius = 21.0, condyle_offset = 24.0 }"
    knee = Scene.from_toml(text.replace("[geometry]", own))
    assert knee.patch_geometry("med")["frontal_radius"] == 21.0
    assert knee.patch_geometry("lat")["frontal_radius"] == 22.0
    assert knee.anchors_mm[:, 2].tolist() == [24.0, -22.0]
