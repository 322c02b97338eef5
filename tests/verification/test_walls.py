"""Load on a wall that is too steep for elements is told, as large as it is, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.verification import share_on_walls, words_on_walls
from problems.pose_estimation.report import OnFoundation
from problems.pose_estimation.wanted import WantedLoads
from tests.support.ball_in_corner import RADIUS_MM, force_n, write_corner
from tests.support.meshes import mesh_scene_text, sheet_mesh, wheel_mesh, write_obj


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_corner(tmp_path_factory.mktemp("walls"))


def model_of(folder, elements="grid"):
    path = folder / f"{elements}.toml"
    path.write_text(mesh_scene_text(folder / "ball.obj", folder / "post.obj", elements=elements))
    return cc.ElasticFoundation(cc.load_scene(path), (160, 160))


def test_a_ball_pressed_into_the_corner_of_floor_and_wall_bears_on_both_as_on_two_planes(folder):
    model = model_of(folder)
    floor, both, wall = (
        [RADIUS_MM - on_wall, RADIUS_MM - on_floor, 0.0, 0.0, 0.0, 0.0]
        for on_wall, on_floor in ((-3.0, 0.2), (0.2, 0.3), (0.3, -0.5))
    )
    share = share_on_walls(model, np.array([floor, both, wall]))
    assert share[0] == 0.0
    assert share[1] == pytest.approx(force_n(0.2) / (force_n(0.2) + force_n(0.3)), rel=0.05)
    assert share[2] == 1.0
    np.testing.assert_allclose(model.wrenches(wall), 0.0, atol=1e-9)  # and so nothing else tells it
    assert not model.at_edge(wall).any()
    assert "in 2 of 3 frames up to 100%" in words_on_walls(share)


def test_a_cup_centre_on_the_axis_of_a_notch_counts_what_its_walls_carry(tmp_path):
    """A roller pressed sideways into a half-pipe: N = (K/h) L R ∫ (e cos φ - c) cos φ dφ for a clearance c, a way e."""
    radius, clearance, way, width = 20.0, 0.4, 0.45, 10.0
    points, faces = sheet_mesh(2.0, 0.02)
    angle = 1.9 * points[:, 0]
    pipe = np.stack([radius * np.sin(angle), -radius * np.cos(angle), 8.0 * points[:, 2]], axis=1)
    write_obj(tmp_path / "pipe.obj", pipe, faces)
    write_obj(tmp_path / "roller.obj", *wheel_mesh(radius - clearance, 0.5 * width, 0.6))
    pose = np.array([way * np.sin(1.2), -way * np.cos(1.2), 0.0, 0.0, 0.0, 0.0])
    reach = np.arccos(clearance / way)
    integral = way * (reach + 0.5 * np.sin(2.0 * reach)) - 2.0 * clearance * np.sin(reach)
    found = {}
    for key in ("", "cup_centre = [0.0, 0.0, 0.0]"):
        (tmp_path / "notch.toml").write_text(mesh_scene_text("roller.obj", "pipe.obj", extra=key))
        model = cc.ElasticFoundation(cc.load_scene(tmp_path / "notch.toml"), (200, 80))
        force = float(np.linalg.norm(model.wrenches(pose)[0, :3]))
        found[key] = force / (267.5728 * width * radius * integral), words_on_walls(share_on_walls(model, [pose]))
    (lost, told), (whole, nothing) = found.values()
    assert lost < 0.8
    assert "geometry.cup_centre" in told
    assert whole == pytest.approx(1.0, abs=0.04)
    assert nothing is None


def test_a_ball_on_the_floor_alone_leaves_nothing_to_tell(folder):
    assert words_on_walls(share_on_walls(model_of(folder), [[12.0, 7.8, 0.0, 0.0, 0.0, 0.0]])) is None


def test_pose_estimation_tells_what_its_verdict_cannot_know(folder):
    scene = model_of(folder).scene
    poses = np.array([[7.8, 7.7, 0.0, 0.0, 0.0, 0.0], [12.0, 7.7, 0.0, 0.0, 0.0, 0.0]])
    wanted = WantedLoads.of(scene, {"Fy": np.full(2, -force_n(0.3))})
    problem = SimpleNamespace(wanted=wanted, model=SimpleNamespace(scene=scene))
    found = OnFoundation.of(problem, SimpleNamespace(poses=poses))
    np.testing.assert_allclose(found.teacher[:, 0], -force_n(0.3), rtol=0.05)  # what is wanted, and so verified
    assert found.record()["largest_share_on_walls"] == found.on_walls[0] > 0.2
    assert found.on_walls[1] == 0.0
    assert found.doubts == [words_on_walls(found.on_walls)]


def test_elements_that_are_the_triangles_bear_on_walls_as_well(folder):
    share = share_on_walls(model_of(folder, "triangles"), [[7.7, 8.5, 0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(share, 0.0)


def test_a_parametric_body_has_none():
    model = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (40, 40))
    np.testing.assert_array_equal(share_on_walls(model, [model.scene.start_pose]), 0.0)
