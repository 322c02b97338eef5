"""Pictures of contact show the forces that the model computes, and are written headless."""

import numpy as np
import pytest
from typer.testing import CliRunner

import casadi_contact as cc
from casadi_contact.cli.main import app
from casadi_contact.pictures.contact_picture import draw_contact, loads_text, pressures_text, surface_fits
from casadi_contact.pictures.page import new_page, save_page
from tests.support.meshes import cap_mesh, ground_scene_text, mesh_scene_text, sheet_mesh, write_obj

POSE = np.array([0.5, 27.2, 0.1, 0.0, -0.05, -0.3])
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def model():
    return cc.ElasticFoundation(cc.load_scene("knee"))


def test_pressures_add_up_to_the_forces_and_their_centre_to_the_torques(model):
    wrenches = model.wrenches(POSE[None])[0]
    for wrench, pressed in zip(wrenches, model.pressure_maps(POSE), strict=True):
        # A dish's normals lean away from +y by little within the contact.
        assert (pressed.pressures_mpa @ pressed.areas_mm2) == pytest.approx(np.linalg.norm(wrench[:3]), rel=0.01)
        centre = pressed.centre_mm
        assert centre[[0, 2]] == pytest.approx([wrench[5] / wrench[1], -wrench[3] / wrench[1]], abs=0.3)
    assert model.pressure_maps([0.5, 36.0, *POSE[2:]])[0].centre_mm is None


def test_one_pose_and_many_are_drawn(model, tmp_path):
    draw_contact(model, POSE[None], tmp_path / "one.png")
    draw_contact(model, np.tile(POSE, (20, 1)), tmp_path / "strip.png")
    for name in ("one.png", "strip.png"):
        assert (tmp_path / name).read_bytes()[:4] == PNG
    with pytest.raises(ValueError, match="no pose to draw"):
        draw_contact(model, np.zeros((0, 6)), tmp_path / "a.png")


def test_the_loads_of_a_picture_are_the_models(model):
    loads = dict(zip(model.load_names, model(POSE[None])[0], strict=True))
    area = model.summary(POSE[None]).area_mm2[0, 0]
    assert pressures_text(model, POSE).startswith(f"med: {area:.0f} mm², mean ")
    assert pressures_text(model, np.array([0.5, 36.0, *POSE[2:]])) == "med: no contact; lat: no contact"
    assert loads_text(model, POSE, ("Fy_lat", "Tz")) == f"Fy_lat {loads['Fy_lat']:.0f} N, Tz {loads['Tz']:.0f} N·mm"


@pytest.mark.parametrize("fixed", ["sheet", "cap"])
def test_of_meshes_the_fit_is_drawn_as_well_and_of_others_it_is_not(tmp_path, model, fixed):
    write_obj(tmp_path / "cap.obj", *cap_mesh(20.0, 1.2, 0.5))
    write_obj(tmp_path / "sheet.obj", *sheet_mesh(20.0, 1.0))
    text = mesh_scene_text("cap.obj", "sheet.obj") if fixed == "sheet" else ground_scene_text("cap.obj")
    (tmp_path / "scene.toml").write_text(text)
    result = CliRunner().invoke(app, ["show", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "meshes.png")])
    assert result.exit_code == 0, result.output
    for name in ("meshes.png", "meshes_fit.png"):
        assert (tmp_path / name).read_bytes()[:4] == PNG
    assert "mm RMS" in result.output
    assert "meshes_fit.png" in result.output
    assert surface_fits(model) == []


@pytest.mark.parametrize(("name", "begins"), [("p.svg", b"<?xml"), ("p", PNG)])
def test_a_page_is_written_in_the_format_of_its_ending(tmp_path, name, begins):
    save_page(new_page(3.0, 2.0), tmp_path / name, dots_per_inch=50)
    assert (tmp_path / name).read_bytes().startswith(begins)
