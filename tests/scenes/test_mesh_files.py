"""Scenes of mesh files: paths from the scene file, digests of what the files hold, bad keys by name."""

import shutil

import pytest

import casadi_contact as cc
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, write_obj


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "here").mkdir()
    write_obj(tmp_path / "here" / "ball.obj", *cap_mesh(20.0, 3.0, 0.5))
    write_obj(tmp_path / "here" / "plate.obj", *sheet_mesh(10.0, 2.0))
    (tmp_path / "here" / "scene.toml").write_text(mesh_scene_text("ball.obj", "plate.obj"))
    return tmp_path / "here"


def test_a_mesh_scene_is_the_same_wherever_its_files_lie(folder, tmp_path):
    scene = cc.load_scene(folder / "scene.toml")
    again = Scene.from_toml(scene.to_toml())
    assert again == scene
    assert again.digest == scene.digest
    shutil.copytree(folder, tmp_path / "there")
    assert cc.load_scene(tmp_path / "there" / "scene.toml").digest == scene.digest
    assert scene.with_overrides(thickness=5.0).digest != scene.digest


def test_a_changed_or_missing_mesh_is_another_scene_or_an_error(folder):
    scene = cc.load_scene(folder / "scene.toml")
    write_obj(folder / "ball.obj", *cap_mesh(21.0, 3.0, 0.5))
    assert cc.load_scene(folder / "scene.toml").digest != scene.digest
    with pytest.raises(ValueError, match="changed"):
        body_mesh(scene.geometry, "moving")
    (folder / "as_made.toml").write_text(scene.to_toml())
    with pytest.raises(ValueError, match="changed"):
        cc.load_scene(folder / "as_made.toml")
    (folder / "ball.obj").unlink()
    with pytest.raises(FileNotFoundError, match="exist"):
        cc.load_scene(folder / "scene.toml")
