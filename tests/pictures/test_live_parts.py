"""What a page is made of: triangles, packed arrays, WebAssembly."""

import hashlib
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.pictures import joint_page as compiling
from casadi_contact.pictures.drawn_bodies import MOST_TRIANGLES, Triangles, fewer_triangles, fixed_surfaces, moving_body
from casadi_contact.pictures.joint_page import joint_page, page_cycle
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.pose_file import write_poses
from tests.support.meshes import cap_mesh


def square(step=1.0):
    x, z = np.meshgrid(np.arange(0.0, 5.0, step), np.arange(0.0, 4.0, step), indexing="ij")
    return Triangles.of_grid(np.stack([x, 0.0 * x, z], -1), np.broadcast_to([0.0, 1.0, 0.0], (*x.shape, 3)))


def test_poses_of_a_file_keep_their_times(tmp_path):
    model = SimpleNamespace(scene=cc.load_scene("knee"))
    poses = np.tile(model.scene.start_pose, (3, 1))
    write_poses(np.array([10.0, 10.1, 12.0]), poses, tmp_path / "poses.csv")
    assert page_cycle(model, str(tmp_path / "poses.csv")).time_s.tolist() == [10.0, 10.1, 12.0]
    columns = dict(zip(POSE_NAMES, poses.T, strict=True))
    write_columns(tmp_path / "poses.csv", columns)
    assert page_cycle(model, str(tmp_path / "poses.csv")).time_s.tolist() == [0.0, 0.5, 1.0]


def test_a_mesh_is_drawn_with_fewer_triangles_that_lie_on_its_surface():
    points, faces = cap_mesh(25.0, 0.5, 1.0)
    fewer_points, fewer = fewer_triangles(points, faces)
    assert len(fewer) <= MOST_TRIANGLES < len(faces)
    np.testing.assert_allclose(np.linalg.norm(fewer_points[np.unique(fewer)], axis=1), 25.0, atol=0.05)
    size, drawn = (trimesh.Trimesh(*mesh).area for mesh in ((points, faces), (fewer_points, fewer)))
    assert drawn == pytest.approx(size, rel=0.01)


def test_a_surface_with_what_lies_behind_it_is_a_closed_body():
    """Its volume is area × thickness, its faces look outwards."""
    both = Triangles.together([square(), square().behind(3.0)])
    body = trimesh.Trimesh(both.points_mm, both.corners)
    assert body.is_watertight
    assert body.volume == pytest.approx(36.0)


@pytest.mark.parametrize("scene", ["knee", "hip", "cylinder_on_plane", "punch_on_plane"])
def test_points_of_the_drawn_moving_body_lie_on_its_surface(scene):
    loaded = cc.load_scene(scene)
    model = cc.ElasticFoundation(loaded, (8, 8))
    points = moving_body(loaded).points_mm
    distances = np.stack([model.distances(points, np.zeros(6), patch) for patch in loaded.patch_names])
    np.testing.assert_allclose(np.abs(distances).min(axis=0), 0.0, atol=1e-9)


@pytest.mark.parametrize("scene", ["knee", "hip"])
def test_the_drawn_fixed_surface_has_the_area_of_the_scene_s_elements(scene):
    model = cc.foundation(scene)
    for surface, elements in zip(fixed_surfaces(model), model.scene.elements((60, 60)), strict=True):
        size = trimesh.Trimesh(surface.triangles.points_mm, surface.triangles.corners).area
        assert size == pytest.approx(elements.areas_mm2.sum(), rel=0.01)


def test_without_its_compiler_the_command_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(compiling, "find_spec", lambda name: None)
    done = CliRunner().invoke(app, ["page", "hip", "--out", str(tmp_path / "hip.html")])
    assert done.exit_code != 0
    assert "pip install casadi_contact[page]" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_a_surrogate_of_another_scene_and_a_scene_without_pressures_are_refused():
    with pytest.raises(ValueError, match=r"another scene \(knee\)"):
        joint_page("hip", surrogate="knee")
    with pytest.raises(ValueError, match="thickness"):
        joint_page("foot_on_ground")


def test_the_library_that_draws_is_the_one_that_its_makers_published():
    """twgl.js 7.0.0, dist/7.x/twgl-full.js of the npm package."""
    folder = resources.files("casadi_contact.pictures") / "third_party"
    digest = hashlib.sha256((folder / "twgl-full.js").read_bytes()).hexdigest()
    assert digest == "a1096308034021de808dee4906dbe69e2d22783ee4ef2ff5a5c12bf7208c8cba"
