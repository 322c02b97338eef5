"""Placed, mirrored and turned meshes: the same contact, seen from another frame."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import rotation
from casadi_contact.geometry.mesh import Placement, checked_mesh
from tests.support.meshes import cap_mesh, groove, mesh_scene_text, sheet_mesh, write_obj

POSE = np.array([0.4, 19.8, 0.3, 0.02, 0.1, -0.05])


@pytest.fixture
def model(tmp_path):
    """A model of a ball in a valley, with lines added to [geometry] and the text replaced."""
    write_obj(tmp_path / "ball.obj", *cap_mesh(20.0, 2.0, 0.6))
    write_obj(tmp_path / "valley.obj", *sheet_mesh(24.0, 2.0, lambda x, z: 0.3 * groove(x, z)))

    def made(lines="", replaced=("", ""), patches=""):
        text = mesh_scene_text("ball.obj", "valley.obj", extra=f"{lines}\n{patches}", grid=(60, 60))
        (tmp_path / "scene.toml").write_text(text.replace(*replaced))
        return cc.ElasticFoundation(cc.load_scene(tmp_path / "scene.toml"))

    return made


def test_an_offset_of_the_moving_mesh_is_a_shift_of_the_pose(model):
    offset = np.array([1.0, -3.0, 2.0])
    moved = model(f"[geometry.placement.moving]\noffset = {offset.tolist()}")
    pose = POSE.copy()
    pose[:3] -= rotation(POSE[3:]) @ offset
    loads = model().wrenches(POSE)
    assert loads[0, 1] < -100.0
    np.testing.assert_allclose(moved.wrenches(pose), loads, rtol=1e-3, atol=0.5)  # fields on other nodes


def test_an_offset_of_the_fixed_mesh_shifts_pose_and_torque(model):
    """Centres of pressure refer to the fixed origin: F stays, T grows by offset × F."""
    offset = np.array([4.0, 0.0, -2.0])
    loads = model().wrenches(POSE)[0]
    moved = model(f"[geometry.placement.fixed]\noffset = {offset.tolist()}").wrenches(POSE + np.pad(offset, (0, 3)))[0]
    np.testing.assert_allclose(moved[:3], loads[:3], rtol=1e-3, atol=0.5)
    np.testing.assert_allclose(moved[3:], loads[3:] + np.cross(offset, loads[:3]), rtol=1e-3, atol=5.0)


def test_a_joint_mirrored_in_z_mirrors_pose_and_loads(model):
    both = "".join(f'[geometry.placement.{body}]\nmirror = "z"\n' for body in ("moving", "fixed"))
    signs = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])  # of a vector, then of an axial vector
    loads = model().wrenches(POSE)[0]
    np.testing.assert_allclose(model(both).wrenches(POSE * signs)[0], loads * signs, rtol=2e-3, atol=5.0)


def test_a_joint_pressed_along_x_carries_what_one_pressed_along_minus_y_does(model):
    """Turned by 90 degrees about z as a whole: y becomes -x."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # of the file: its y is the library's -x
    pressed = model('axes = ["-y", "x", "z"]\npressing = [1.0, 0.0, 0.0]')
    pose = np.array([0.4, 19.8, 0.3, 0.0, 0.1, 0.0])
    turned = np.array([-19.8, 0.4, 0.3, -0.1, 0.0, 0.0])
    loads, seen = model().wrenches(pose)[0], pressed.wrenches(turned)[0]
    np.testing.assert_allclose(seen, np.concatenate([turn @ loads[:3], turn @ loads[3:]]), rtol=2e-3, atol=5.0)


def test_a_grid_pressed_obliquely_covers_the_same_surface(model):
    straight = model(patches="[geometry.patches.contact]\nx = [-6.0, 6.0]\nz = [-6.0, 6.0]")
    oblique = model(
        "pressing = [0.3, -1.0, 0.2]", patches="[geometry.patches.contact]\nx = [-6.0, 6.0]\nz = [-6.0, 6.0]"
    )
    area, other = (m.scene.elements((200, 200))[0].areas_mm2.sum() for m in (straight, oblique))
    assert other == pytest.approx(area, rel=0.01)
    np.testing.assert_allclose(oblique(POSE), straight(POSE), rtol=0.01, atol=20.0)


def test_the_start_pose_is_the_scene_s(model):
    scene = model("start_pose = [1.0, 20.0, 0.0, 0.0, 0.1, 0.0]").scene
    np.testing.assert_array_equal(scene.start_pose, [1.0, 20.0, 0.0, 0.0, 0.1, 0.0])
    np.testing.assert_array_equal(model().scene.start_pose, np.zeros(6))


def test_a_mirrored_closed_mesh_still_encloses_its_volume():
    corners = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    mesh = checked_mesh("tetrahedron", corners, faces, placement=Placement((5.0, 0.0, 0.0), (0.0, 0.0, 90.0), "x"))
    np.testing.assert_allclose(mesh.vertices_mm.min(axis=0), [-5.0, -10.0, 0.0], atol=1e-9)  # no "inside-out" raised
    assert len(mesh.faces) == 4
