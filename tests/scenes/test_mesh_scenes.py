"""Scenes of mesh files: the same wherever they lie; placed and turned, the same contact."""

import shutil

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import rotation
from casadi_contact.geometry.mesh import Placement, checked_mesh
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh
from tests.support.meshes import cap_mesh, groove, mesh_scene_text, sheet_mesh, write_obj

POSE = np.array([0.4, 19.8, 0.3, 0.02, 0.1, -0.05])


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


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model of a ball in a valley, with lines added to [geometry]."""
    folder = tmp_path_factory.mktemp("valley")
    write_obj(folder / "ball.obj", *cap_mesh(20.0, 2.0, 0.6))
    write_obj(folder / "valley.obj", *sheet_mesh(24.0, 2.0, lambda x, z: 0.3 * groove(x, z)))

    def made(lines=""):
        (folder / "scene.toml").write_text(mesh_scene_text("ball.obj", "valley.obj", extra=lines, grid=(60, 60)))
        return cc.ElasticFoundation(cc.load_scene(folder / "scene.toml"))

    return made


OFFSET = np.array([1.0, -3.0, 2.0])
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # of the file: its y is the library's -x
MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])  # of a vector, then of an axial vector


def offset_moving(pose, load):
    """A shift of the pose."""
    return pose - [*rotation(pose[3:]) @ OFFSET, 0.0, 0.0, 0.0], load


def offset_fixed(pose, load):
    """Centres of pressure refer to the fixed origin: F stays, T grows by offset × F."""
    return pose + np.pad(OFFSET, (0, 3)), load + np.pad(np.cross(OFFSET, load[:3]), (3, 0))


@pytest.mark.parametrize(
    ("lines", "seen"),
    [
        (f"[geometry.placement.moving]\noffset = {OFFSET.tolist()}", offset_moving),
        (f"[geometry.placement.fixed]\noffset = {OFFSET.tolist()}", offset_fixed),
        (
            '[geometry.placement.moving]\nmirror = "z"\n[geometry.placement.fixed]\nmirror = "z"\n',
            lambda pose, load: (pose * MIRROR, load * MIRROR),
        ),
        (
            'axes = ["-y", "x", "z"]\npressing = [1.0, 0.0, 0.0]',  # turned by 90 degrees about z as a whole
            lambda pose, load: (pose.reshape(2, 3) @ TURN.T, load.reshape(2, 3) @ TURN.T),
        ),
    ],
    ids=["moving", "fixed", "mirrored", "turned"],
)
def test_a_placed_mirrored_or_turned_joint_carries_what_it_did(model, lines, seen):
    start = POSE * [1.0, 1.0, 1.0, 0.0, 1.0, 0.0] if "axes" in lines else POSE  # angles about one axis turn as a vector
    loads = model().wrenches(start)[0]
    assert loads[1] < -100.0
    pose, expected = seen(start, loads)
    np.testing.assert_allclose(model(lines).wrenches(np.ravel(pose))[0], np.ravel(expected), rtol=2e-3, atol=5.0)


def test_a_grid_pressed_obliquely_covers_the_same_surface(model):
    patch = "[geometry.patches.contact]\nx = [-6.0, 6.0]\nz = [-6.0, 6.0]"
    straight, oblique = model(patch), model(f"pressing = [0.3, -1.0, 0.2]\n{patch}")
    area, other = (m.scene.elements((200, 200))[0].areas_mm2.sum() for m in (straight, oblique))
    assert other == pytest.approx(area, rel=0.01)
    np.testing.assert_allclose(oblique(POSE), straight(POSE), rtol=0.01, atol=20.0)


def test_a_mirrored_closed_mesh_still_encloses_its_volume():
    corners = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    mesh = checked_mesh("tetrahedron", corners, faces, placement=Placement((5.0, 0.0, 0.0), (0.0, 0.0, 90.0), "x"))
    np.testing.assert_allclose(mesh.vertices_mm.min(axis=0), [-5.0, -10.0, 0.0], atol=1e-9)  # no "inside-out" raised
    assert len(mesh.faces) == 4
