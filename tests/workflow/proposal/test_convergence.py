"""Convergence tests: loads at rest, and distance fields of thin bodies."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, shell_thickness
from casadi_contact.workflow.proposal import convergence
from casadi_contact.workflow.proposal.convergence import RestPose, converged_spacing, rest_loads
from casadi_contact.workflow.proposal.joint_geometry import Joint
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, slab_mesh, write_obj

OVERLAP_MM, RADIUS_MM = 0.1, 20.0
EXACT_N = np.pi * 267.5728 * OVERLAP_MM**2 * (RADIUS_MM - OVERLAP_MM / 3.0)


def pressed(overlap_mm):
    return np.array([0.0, RADIUS_MM - overlap_mm, 0.0, 0.0, 0.0, 0.0])


PLATE = Joint("other", ("contact",), "-y")


def converged(folder, monkeypatch, thickness_mm, overlap_mm=OVERLAP_MM):
    """The model of a ball that rests at this overlap on a plate of this thickness."""
    monkeypatch.setattr(convergence, "rest_pose", lambda model, *given: RestPose(model, pressed(overlap_mm), ""))
    write_obj(folder / "ball.obj", *cap_mesh(RADIUS_MM, 1.0, 0.2))
    write_obj(folder / "plate.obj", *slab_mesh(*sheet_mesh(8.0, 0.5), thickness_mm))
    text = mesh_scene_text("ball.obj", "plate.obj", grid=(60, 60), extra="spacing = 0.75")
    (folder / "scene.toml").write_text(text)
    scene = cc.load_scene(folder / "scene.toml")
    meshes = {body: body_mesh(scene.geometry, body) for body in ("moving", "fixed")}
    thickness = {body: shell_thickness(mesh) for body, mesh in meshes.items()}
    return converged_spacing(scene.tables, meshes, thickness, PLATE, (0.0, -1.0, 0.0))


@pytest.mark.parametrize("thickness_mm", [1.2, 6.0])
def test_a_ball_on_a_thin_plate_carries_its_closed_form(tmp_path, monkeypatch, thickness_mm):
    rest = converged(tmp_path, monkeypatch, thickness_mm)
    assert -rest.model.wrenches(pressed(OVERLAP_MM))[0, 1] == pytest.approx(EXACT_N, rel=0.015)
    assert rest.fine_enough
    assert rest.model.scene.geometry["spacing"]["moving"] == 0.75, "its own surface is open"


@pytest.mark.parametrize("overlap_mm", [0.003, -1.0])
def test_a_field_is_not_fine_enough_if_forces_still_change_or_are_zero(tmp_path, monkeypatch, overlap_mm):
    """The error of a surface is a fraction of the thickness, which is large against so small an overlap."""
    rest = converged(tmp_path, monkeypatch, 1.2, overlap_mm)
    assert not rest.fine_enough
    assert "fine enough" in rest.spacing_remark


def test_a_field_that_does_not_fit_into_memory_is_not_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(convergence, "field_fits", lambda mesh, spacing_mm: spacing_mm > 0.2)
    rest = converged(tmp_path, monkeypatch, 1.2)
    assert not rest.fine_enough
    assert "memory" in rest.spacing_remark


def test_fields_of_nearly_equal_spacing_are_not_compared(tmp_path, monkeypatch):
    assert converged(tmp_path, monkeypatch, 7.45).spacing_remark == ""


def test_a_force_that_turns_presses_down_unless_the_scene_names_a_direction():
    loads = rest_loads(cc.load_scene("hip"), Joint("other", ("contact",), ""), 100.0)
    assert loads == {"Fx": 0.0, "Fy": -100.0, "Fz": 0.0}
