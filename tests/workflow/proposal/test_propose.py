"""A proposed scene needs no editing: it loads, settles its reference motion, and says what was not told."""

import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.samples.chunk import plan_chunks
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.cycle import scene_cycles
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, shell_thickness
from casadi_contact.workflow.proposal import pair
from casadi_contact.workflow.proposal import propose as proposing
from casadi_contact.workflow.proposal.propose import thin_spacing
from casadi_contact.workflow.proposal.tables import scene_text
from tests.support.meshes import (
    ball_mesh,
    cap_mesh,
    groove,
    mesh_scene_text,
    sheet_mesh,
    shell_mesh,
    slab_mesh,
    unit,
    write_obj,
)

POLE = [0.2, 0.8, 0.5]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("proposal")
    write_obj(folder / "ball.obj", *ball_mesh(16.0, 2.5))
    write_obj(folder / "cup.obj", *shell_mesh(16.4, 22.0, 2.0, 1.3, POLE))
    button, faces = cap_mesh(22.0, 1.5, 0.7)
    write_obj(folder / "button.obj", button + np.array([0.0, 22.0, 0.0]), faces)
    write_obj(folder / "groove.obj", *sheet_mesh(40.0, 2.0, groove))
    return folder


def proposed(folder, moving, fixed, *options):
    """The output of the command and the scene it wrote."""
    path = folder / f"{fixed}.toml"
    arguments = ["scene", str(folder / f"{moving}.obj"), str(folder / f"{fixed}.obj"), "--out", str(path), *options]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert path.with_suffix(".png").stat().st_size > 10_000
    return " ".join(result.output.split()), cc.load_scene(path)


def test_a_ball_in_a_cup(folder):
    output, scene = proposed(folder, "ball", "cup")
    assert "202 of 202 reference frames settle" in output
    assert "not given by the meshes: the material's stiffness and thickness: taken as cartilage, since" in output
    assert "as a scan's do (--material)" in output  # a frame is no proof
    assert scene.patch_names == ("contact",)
    assert unit(np.array(scene.geometry["pressing"])) @ unit(np.array(POLE)) > 0.99
    model = cc.ElasticFoundation(scene)
    assert np.linalg.norm(model.wrenches(scene.start_pose)[0, :3]) == pytest.approx(300.0, rel=0.1)
    larger = cc.ElasticFoundation(scene, (140, 140))(scene.start_pose)
    off = np.abs(model(scene.start_pose) - larger) / [scene.tolerances[name] for name in scene.load_names]
    assert off.max() < 2.0  # the grids are fine enough


def test_a_joint_in_axes_that_are_given_is_pressed_as_it_lies_in_them(folder, monkeypatch):
    """A socket above its ball is pressed up, a load of +Fy; without a pose at rest one of the motion is the start."""
    monkeypatch.setattr(proposing, "rest_pose", lambda model, *_: (np.zeros(6), False))
    socket, faces = slab_mesh(*sheet_mesh(18.0, 1.5, lambda x, z: (x**2 + z**2) / 30.0), 4.0)
    write_obj(folder / "condyle.obj", *ball_mesh(6.0, 1.0))
    write_obj(folder / "fossa.obj", np.array([0.0, 6.0, 0.0]) - socket * [1.0, 1.0, -1.0], faces)
    output, scene = proposed(folder, "condyle", "fossa", "--axes", "x,y,z")
    assert "202 of 202 reference frames settle" in output
    assert scene.geometry["axes"] == ["x", "y", "z"]
    assert scene.geometry["pressing"] == [0.0, 1.0, 0.0]
    fy = scene.load_names.index("Fy")
    assert cc.ElasticFoundation(scene)(scene.start_pose)[fy] > 0.0
    assert scene.sensitive_loads == ("Fy",)
    assert "at rest" not in output


def test_a_button_in_a_groove(folder):
    output, scene = proposed(folder, "button", "groove")
    assert "202 of 202 reference frames settle" in output
    assert scene.patch_names == ("med", "lat")
    assert scene.load_names[:2] == ("Fx_med", "Fx_lat")
    loads = cc.ElasticFoundation(scene)(scene.start_pose)
    np.testing.assert_allclose(loads[:2], 300.0, rtol=0.1)
    model, settings = cc.ElasticFoundation(scene, (20, 20)), SamplingSettings.from_scene(scene, frames=5, scale=0.01)
    motion, report = reference_motion(model, scene_cycles(scene)[:2], settings)
    assert report.assumed == {"ty": 1.0}, "the made-up motion leaves it still"
    planned = {chunk.domain for chunk in plan_chunks(scene, motion, settings)}
    assert planned == {1, 2, 3, 4, 5, 6, 7}, "every domain can be drawn"


def refused(*arguments):
    result = CliRunner().invoke(app, ["scene", *map(str, arguments)])
    assert isinstance(result.exception, ValueError)
    return str(result.exception)


def test_bad_names_and_units_and_files_that_are_there_are_refused_before_any_work(folder):
    (folder / "01_cup.obj").write_bytes((folder / "cup.obj").read_bytes())
    assert "--out" in refused(folder / "ball.obj", folder / "01_cup.obj")
    files = (folder / "ball.obj", folder / "cup.obj", "--out", folder / "other.toml")
    assert "inch" in refused(*files, "--units", "foot")
    assert "mm across" in refused(*files, "--units", "m")
    for name, (vertices, faces) in (("ball", ball_mesh(16.0, 2.5)), ("cup", shell_mesh(16.4, 22.0, 2.0, 1.3, POLE))):
        write_obj(folder / f"{name}_cm.obj", 0.1 * vertices, faces)
    kept = folder / "mine.toml"
    kept.write_text("# mine")
    assert "mine.toml would be replaced" in refused(folder / "ball.obj", folder / "cup.obj", "--out", kept)
    assert kept.read_text() == "# mine"
    output = refused(folder / "ball_cm.obj", folder / "cup_cm.obj", "--out", folder / "cm.toml")
    assert re.search(r"is 4\.15 mm across in mm, 41\.5 mm across in cm, 105 mm across in inch.*--units", output)


def test_a_scene_file_reads_back_as_its_tables(folder):
    """Spaces, brackets and commas in file names, and a spacing that is a table."""
    spacing = {"moving": 0.75, "fixed": 0.157}
    geometry = {"moving": str(folder / "a  b" / "[ x, ].stl"), "fixed": str(folder / "c.stl"), "spacing": spacing}
    tables = {"name": "own", "geometry": geometry, "grids": {"fine": [40, 20]}, "loads": {"names": ["Fx", "Fy"]}}
    written = tomllib.loads(scene_text(SimpleNamespace(tables=tables), ["remark"], folder))
    assert written["geometry"] == {**geometry, "moving": "a  b/[ x, ].stl", "fixed": "c.stl"}
    assert {**written, "geometry": geometry} == tables


OVERLAP_MM, RADIUS_MM = 0.1, 20.0
EXACT_N = np.pi * 267.5728 * OVERLAP_MM**2 * (RADIUS_MM - OVERLAP_MM / 3.0)


def test_a_ball_on_a_thin_plate_carries_its_closed_form(tmp_path, monkeypatch):
    write_obj(tmp_path / "ball.obj", *cap_mesh(RADIUS_MM, 1.0, 0.2))
    write_obj(tmp_path / "plate.obj", *slab_mesh(*sheet_mesh(8.0, 0.5), 1.2))
    path = tmp_path / "scene.toml"
    path.write_text(mesh_scene_text("ball.obj", "plate.obj", grid=(60, 60), extra="spacing = 0.75"))
    loaded = cc.load_scene(path)
    meshes = {body: body_mesh(loaded.geometry, body) for body in ("moving", "fixed")}
    thickness = {body: shell_thickness(mesh) for body, mesh in meshes.items()}
    spacing = thin_spacing(meshes, thickness, 0.75)
    assert spacing == {"moving": 0.75, "fixed": pytest.approx(0.18)}, "the ball's own surface is open"
    scene = cc.Scene.from_tables({**loaded.tables, "geometry": {**loaded.tables["geometry"], "spacing": spacing}})
    pressed = np.array([0.0, RADIUS_MM - OVERLAP_MM, 0.0, 0.0, 0.0, 0.0])
    assert -cc.ElasticFoundation(scene).wrenches(pressed)[0, 1] == pytest.approx(EXACT_N, rel=0.015)
    monkeypatch.setattr(proposing, "field_fits", lambda mesh, spacing_mm: spacing_mm > 0.2)
    assert thin_spacing(meshes, thickness, 0.75)["fixed"] == pytest.approx(0.3)


def test_a_sole_that_is_given_before_its_ground(folder, monkeypatch):
    """Outline, heel and toe rise, round edges: the ground is what moves. Fields and grids are coarse, to save time."""
    monkeypatch.setattr(proposing, "CANDIDATES", ((40, 40),))
    monkeypatch.setattr(proposing, "CONVERGED", (60, 60))
    monkeypatch.setattr(proposing, "thin_spacing", lambda *_: {"moving": 1.33, "fixed": 1.33})
    monkeypatch.setattr(pair, "SETTINGS", replace(pair.SETTINGS, spacing_mm=4.0, most_points=2000))
    sheet, faces = sheet_mesh(20.0, 1.0, lambda x, z: -(np.maximum(np.abs(x) - 6.0, 0.0) ** 2) - 0.08 * z**2)
    sheet[:, 2] *= 2.5 + np.exp(-(((sheet[:, 0] - 4.0) / 5.0) ** 2))
    sole, faces = slab_mesh(sheet * [8.0, 1.0, 1.0], faces, 20.0)
    write_obj(folder / "sole.obj", sole * [1.0, -1.0, -1.0], faces)
    write_obj(folder / "ground.obj", *slab_mesh(*sheet_mesh(180.0, 180.0), 20.0))
    output, scene = proposed(folder, "sole", "ground")
    assert "202 of 202 reference frames settle" in output
    assert "taken as sole" in output
    assert [scene.geometry[body].rpartition("/")[2] for body in ("moving", "fixed")] == ["ground.obj", "sole.obj"]
    pressed = cc.ElasticFoundation(scene)(scene.start_pose)
    assert pressed[scene.load_names.index("Fy")] == pytest.approx(-300.0, rel=0.1)
