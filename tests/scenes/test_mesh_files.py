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
    with pytest.raises(ValueError, match="has changed since the scene was made"):
        body_mesh(scene.geometry, "moving")
    (folder / "as_made.toml").write_text(scene.to_toml())
    with pytest.raises(ValueError, match="has changed since the scene was made"):
        cc.load_scene(folder / "as_made.toml")
    (folder / "ball.obj").unlink()
    with pytest.raises(FileNotFoundError, match=r"ball\.obj does not exist"):
        cc.load_scene(folder / "scene.toml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('units = "mm"', "", "geometry lacks units"),
        ('units = "mm"', 'units = "foot"', "geometry.units = 'foot', expected m or mm"),
        ('elements = "grid"', 'elements = "hexes"', "geometry.elements = 'hexes', expected grid or triangles"),
        (
            'units = "mm"',
            'units = "mm"\naxes = ["-x", "y", "z"]',
            "expected three file axes that keep the hand.*lateral of a left one",
        ),
        ('units = "mm"', 'units = "mm"\naxes = ["x", "y", "w"]', "expected three file axes"),
        ('units = "mm"', 'units = "mm"\ncolour = 1', r"unknown key geometry\.colour"),
        ('units = "mm"', 'units = "mm"\nspacing = 0.0', "geometry.spacing = 0.0"),
        ('units = "mm"', 'units = "mm"\nspacing = 1e-9', "geometry.spacing = 1e-09, expected a number between 0.001"),
        (
            'units = "mm"',
            'units = "mm"\nspacing = 3.0',
            "geometry.spacing = 3.0, expected a number between 0.001 and 1.5",
        ),
        ('units = "mm"', 'units = "mm"\nspacing = {moving = 0.5}', "geometry.spacing lacks fixed"),
        ('units = "mm"', 'units = "mm"\nspacing = {moving = 0.5, fixed = -1}', "geometry.spacing.fixed = -1"),
        ("[geometry.patches.contact]", "[geometry.patches.contact]\nx = [2.0, 1.0]", "two rising numbers"),
        ("[geometry.patches.contact]", "[geometry.patches.contact]\nanchor = [2.0]", "3 numbers"),
        ("[geometry.patches.contact]", "[geometry.patches.contact]\nsplit_z = [1]", "needs the patch's z"),
        ("[geometry.patches.contact]", "[geometry.patches.contact]\nz = [0, 2]\nsplit_z = 1", "list of rising"),
        (
            "[geometry.patches.contact]",
            "[geometry.patches.contact]\nz = [0, 2]\nsplit_z = [3]",
            "between 0 and 2",
        ),
        ("[geometry.patches.contact]", "", "geometry lacks patches"),
    ],
)
def test_bad_mesh_scenes_are_refused_with_the_key(folder, old, new, said):
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=said):
        cc.load_scene(folder / "scene.toml")


def test_a_patch_without_mesh_and_a_scene_without_files_are_refused_by_contact_models(folder):
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(text.replace("patches.contact]", "patches.contact]\nx = [50.0, 60.0]"))
    with pytest.raises(ValueError, match=r"plate\.obj: no triangle between"):
        cc.RayCastFoundation(cc.load_scene(folder / "scene.toml"))
    with pytest.raises(ValueError, match="no mesh of its moving body, expected a scene of the shape mesh"):
        cc.RayCastFoundation(cc.load_scene("knee"))
    (folder / "scene.toml").write_text(text.replace("[geometry]", '[geometry]\naxes = ["x", "-y", "-z"]'))
    with pytest.raises(ValueError, match="its surface faces -y: turn it to the moving body"):
        cc.ElasticFoundation(cc.load_scene(folder / "scene.toml"))
