"""A proposed scene tried out: loads at rest, and distance fields of thin bodies."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, shell_thickness
from casadi_contact.workflow.proposal import propose as proposing
from casadi_contact.workflow.proposal.joint_geometry import Joint
from casadi_contact.workflow.proposal.propose import rest_loads, thin_spacing
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, slab_mesh, write_obj

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


def test_a_force_that_turns_presses_down_unless_the_scene_names_a_direction():
    loads = rest_loads(cc.load_scene("hip"), Joint("other", ("contact",), ""), 100.0)
    assert loads == {"Fx": 0.0, "Fy": -100.0, "Fz": 0.0}
