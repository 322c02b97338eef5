"""What a page is made of: triangles, packed arrays, WebAssembly."""

import base64
import gzip
import hashlib
import json
import re
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.pictures import joint_page as page_module
from casadi_contact.pictures import page_model as compiling
from casadi_contact.pictures.drawn_bodies import (
    MOST_TRIANGLES,
    Triangles,
    fewer_triangles,
    fixed_surfaces,
    moving_body,
)
from casadi_contact.pictures.joint_page import joint_page, page_cycle, page_script
from casadi_contact.pictures.page_model import packed
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.pose_file import write_poses
from tests.support.drawn_surfaces import area_vectors_mm2
from tests.support.meshes import ball_mesh, mesh_scene_text, sheet_mesh, write_obj


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


def test_a_surface_with_what_lies_behind_it_is_a_closed_body():
    """Area vectors of a closed body add up to nothing, and its volume is area × thickness."""
    body = Triangles.together([square(), square().behind(3.0)])
    np.testing.assert_allclose(area_vectors_mm2(body).sum(axis=0), 0.0, atol=1e-12)
    middles = body.points_mm[body.corners].mean(axis=1)
    assert np.einsum("ij,ij->", middles, area_vectors_mm2(body)) / 3.0 == pytest.approx(36.0)


@pytest.mark.parametrize("scene", ["knee", "hip", "cylinder_on_plane", "punch_on_plane"])
def test_points_of_the_drawn_moving_body_lie_on_its_surface(scene):
    loaded = cc.load_scene(scene)
    model = cc.ElasticFoundation(loaded, (8, 8))
    points = moving_body(loaded).points_mm
    distances = np.stack([model.distances(points, np.zeros(6), patch) for patch in loaded.patch_names])
    np.testing.assert_allclose(np.abs(distances).min(axis=0), 0.0, atol=1e-9)


def test_a_mesh_is_drawn_with_fewer_triangles_that_lie_on_its_surface():
    from tests.support.meshes import cap_mesh

    points, faces = cap_mesh(25.0, 0.5, 1.0)
    fewer_points, fewer = fewer_triangles(points, faces)
    assert len(fewer) <= MOST_TRIANGLES < len(faces)
    np.testing.assert_allclose(np.linalg.norm(fewer_points[np.unique(fewer)], axis=1), 25.0, atol=0.05)
    size, drawn = (
        np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        for a, b, c in (np.moveaxis(of[corners], 1, 0) for of, corners in ((points, faces), (fewer_points, fewer)))
    )
    assert drawn == pytest.approx(size, rel=0.01)
    assert fewer_triangles(fewer_points, fewer)[1] is fewer


@pytest.mark.parametrize("scene", ["knee", "hip"])
def test_the_drawn_fixed_surface_has_the_area_of_the_scene_s_elements(scene):
    model = cc.foundation(scene)
    for surface, elements in zip(fixed_surfaces(model), model.scene.elements((60, 60)), strict=True):
        size = np.linalg.norm(area_vectors_mm2(surface.triangles), axis=1).sum()
        assert size == pytest.approx(elements.areas_mm2.sum(), rel=0.01)
        assert np.linalg.norm(area_vectors_mm2(surface.coarse), axis=1).sum() == pytest.approx(size, rel=0.01)


def test_packed_arrays_are_the_same_bytes_every_time_and_lie_where_the_index_says():
    given = {"a": np.arange(3, dtype=np.uint8), "b": np.linspace(0.0, 1.0, 5), "c": np.arange(4, dtype=np.uint32)}
    index, text = packed(given)
    assert packed(given) == (index, text)
    data = gzip.decompress(base64.b64decode(text))
    for entry in index:
        array = given[entry["name"]]
        found = np.frombuffer(data, array.dtype, entry["count"], entry["offset"])
        np.testing.assert_array_equal(found, array)


def test_the_page_s_script_has_no_import_left():
    assert not re.search(r"^(import|export) ", page_script(), re.MULTILINE)


def test_the_same_sources_give_the_same_webassembly():
    pytest.importorskip("ziglang", reason="pages need the extra: pip install casadi_contact[page]")
    files = {"one.c": "double one(double x) { return x + 1.0; }\n"}
    first = compiling.webassembly(files, ["one"])
    assert first[:4] == b"\0asm"
    assert compiling.webassembly(files, ["one"]) == first
    with pytest.raises(OSError, match="ziglang failed"):
        compiling.webassembly({"one.c": "double one(\n"}, ["one"])


def test_without_its_compiler_the_command_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(compiling, "find_spec", lambda name: None)
    done = CliRunner().invoke(app, ["page", "hip", "--out", str(tmp_path / "hip.html")])
    assert done.exit_code != 0
    assert "pip install casadi_contact[page]" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_a_surrogate_of_another_scene_is_refused():
    with pytest.raises(ValueError, match=r"trained for another scene \(knee\) than hip"):
        joint_page("hip", surrogate="knee")


def test_a_patch_may_be_called_as_a_body_is(tmp_path, monkeypatch):
    monkeypatch.setattr(page_module, "page_kernel", lambda *models: b"\0asm")
    patch = "moving"
    write_obj(tmp_path / "ball.obj", *ball_mesh(30.0, 3.0))
    write_obj(tmp_path / "plate.obj", *sheet_mesh(16.0, 2.0))
    text = mesh_scene_text("ball.obj", "plate.obj", extra=f"[geometry.patches.{patch}]\n", grid=(20, 20))
    (tmp_path / "scene.toml").write_text(text)
    write_poses(np.zeros(1), [[0.0, 29.9, 0.0, 0.0, 0.0, 0.0]], tmp_path / "poses.csv")
    html, _ = joint_page(str(tmp_path / "scene.toml"), str(tmp_path / "poses.csv"))
    content = json.loads(re.search(r'id="content"[^>]*>(.*?)</script>', html, re.DOTALL)[1])
    sizes = {entry["name"]: entry["count"] for entry in content["arrays"]}
    ball = moving_body(cc.load_scene(tmp_path / "scene.toml"))
    assert sizes["moving_points"] == ball.points_mm.size
    assert 2 * sizes[f"patch_{patch}_points"] == sizes[f"patch_{patch}_places"]  # six numbers a point


def test_the_library_that_draws_is_the_one_that_its_makers_published():
    """twgl.js 7.0.0, dist/7.x/twgl-full.js of the npm package."""
    folder = resources.files("casadi_contact.pictures") / "third_party"
    digest = hashlib.sha256((folder / "twgl-full.js").read_bytes()).hexdigest()
    assert digest == "a1096308034021de808dee4906dbe69e2d22783ee4ef2ff5a5c12bf7208c8cba"
