"""Fields of thin bodies are as fine as their contact needs, and no finer than memory holds."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, shell_thickness
from casadi_contact.workflow.proposal import spacings
from casadi_contact.workflow.proposal.spacings import at_rest
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, slab_mesh, write_obj

OVERLAP_MM, RADIUS_MM = 0.1, 20.0
EXACT_N = np.pi * 267.5728 * OVERLAP_MM**2 * (RADIUS_MM - OVERLAP_MM / 3.0)


def pressed(overlap_mm):
    return np.array([0.0, RADIUS_MM - overlap_mm, 0.0, 0.0, 0.0, 0.0])


def found(folder, thickness_mm, overlap_mm=OVERLAP_MM):
    """What a ball on a plate of this thickness is proposed, resting so deep."""
    write_obj(folder / "ball.obj", *cap_mesh(RADIUS_MM, 1.0, 0.2))
    write_obj(folder / "plate.obj", *slab_mesh(*sheet_mesh(8.0, 0.5), thickness_mm))
    text = mesh_scene_text("ball.obj", "plate.obj", grid=(60, 60), extra="spacing = 0.75")
    (folder / "scene.toml").write_text(text)
    scene = cc.load_scene(folder / "scene.toml")
    meshes = {body: body_mesh(scene.geometry, body) for body in ("moving", "fixed")}
    thickness = {body: shell_thickness(mesh) for body, mesh in meshes.items()}
    return at_rest(scene.tables, meshes, thickness, lambda model: (pressed(overlap_mm), ""))


@pytest.mark.parametrize("thickness_mm", [1.2, 6.0])
def test_a_ball_on_a_thin_plate_carries_its_closed_form(tmp_path, thickness_mm):
    resting = found(tmp_path, thickness_mm)
    assert -resting.model.wrenches(pressed(OVERLAP_MM))[0, 1] == pytest.approx(EXACT_N, rel=0.015)
    assert resting.enough
    assert "changes the forces at rest by" in resting.remark
    assert resting.model.scene.geometry["spacing"]["moving"] == 0.75, "its own surface is open"


def test_a_field_that_would_have_to_be_finer_than_memory_holds_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(spacings, "field_fits", lambda mesh, spacing_mm: spacing_mm > 0.2)
    resting = found(tmp_path, 1.2)
    assert not resting.enough
    assert "whether it is fine enough; one of 0.18 mm does not fit into memory" in resting.remark


@pytest.mark.parametrize(("thickness_mm", "overlap_mm"), [(1.2, 0.003), (6.0, 0.02)])
def test_forces_that_still_change_with_the_finest_field_are_doubted(tmp_path, thickness_mm, overlap_mm):
    """Its surface is off by a fraction of the thickness, which is much of so shallow an overlap."""
    resting = found(tmp_path, thickness_mm, overlap_mm)
    exact = np.pi * 267.5728 * overlap_mm**2 * (RADIUS_MM - overlap_mm / 3.0)
    assert -resting.model.wrenches(pressed(overlap_mm))[0, 1] > 1.03 * exact
    assert not resting.enough
    assert "whether it is fine enough; one of" in resting.remark


def test_without_forces_at_rest_nothing_tells_that_a_field_is_fine_enough(tmp_path):
    resting = found(tmp_path, 1.2, overlap_mm=-1.0)
    assert not resting.enough
    assert "no forces at rest" in resting.remark
    assert "%" not in resting.remark


def test_fields_that_hardly_differ_tell_nothing_of_each_other(tmp_path):
    """A tenth of the thickness is all but the usual spacing."""
    assert found(tmp_path, 7.45).remark == ""
