"""Slips of segmentation: loose specks, spikes and holes are told, and sound bodies have none."""

import numpy as np
import pytest
import trimesh

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.workflow.proposal.damage import folds, holes, specks, spikes, without_specks
from casadi_contact.workflow.proposal.sight import sight_of
from tests.support.meshes import ball_mesh, cap_mesh, sheet_mesh, shell_mesh, slab_mesh, torus_mesh, with_slid_vertex


def with_specks(points, faces, places):
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.6)
    bodies = [(points, faces), *((ball.vertices + place, ball.faces) for place in np.array(places))]
    first = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    joined = [triangles + offset for (_, triangles), offset in zip(bodies, first, strict=False)]
    return np.vstack([vertices for vertices, _ in bodies]), np.concatenate(joined)


def test_a_condyle_on_an_insert_with_specks_above_it_has_one_patch():
    condyle = checked_mesh("condyle", *cap_mesh(25.0, 1.5, 1.2))
    dish = sheet_mesh(48.0, 2.0, lambda x, z: (x**2 + z**2) / 80.0 - 25.0)
    insert = checked_mesh("insert", *with_specks(*dish, [(0.0, -17.0, 12.0), (0.0, -17.0, -12.0)]))
    assert sight_of({"moving": condyle, "fixed": insert}).joint.patches == ("contact",)
    (said,) = specks(insert)
    assert said.startswith("whether 2 loose pieces of insert (8.")
    assert not specks(checked_mesh("dish", *dish))


def test_pieces_of_one_size_are_no_specks():
    """Two plateaus, or a body of many pieces."""
    balls = with_specks(*ball_mesh(0.6, 0.4), [(5.0 * k, 0.0, 0.0) for k in range(1, 30)])
    mesh = checked_mesh("balls", *balls)
    assert without_specks(mesh) is mesh


@pytest.mark.parametrize("out_mm", [5.0, -5.0])
def test_a_single_vertex_that_stands_5_mm_out_of_a_ball_is_told(out_mm):
    points, faces = ball_mesh(20.0, 1.5)
    assert not spikes(checked_mesh("ball", points, faces))
    tip = int(points[:, 1].argmin())
    points = points.copy()
    points[tip] *= 1.0 + out_mm / 20.0
    (said,) = spikes(checked_mesh("ball", points, faces))
    assert "1 of its vertices" in said
    assert f"{points[tip, 1]:.4g}, " in said, "where it is"


@pytest.mark.parametrize(("height_mm", "told"), [(0.8, 1), (0.1, 0)])
def test_a_spike_of_a_small_mesh_is_told_by_the_mesh_s_own_size(height_mm, told):
    """A metatarsal head of 8 mm across, with edges of 0.3 mm."""
    points, faces = ball_mesh(4.0, 0.3)
    tip = int(points[:, 1].argmin())
    points = points.copy()
    points[tip] *= 1.0 + height_mm / 4.0
    assert len(spikes(checked_mesh("head", points, faces))) == told


def test_a_vertex_of_an_open_mesh_that_slid_over_its_neighbours_is_told():
    sound = cap_mesh(20.0, 1.2, 1.0)
    assert not folds(checked_mesh("cap", *sound))
    (said,) = folds(checked_mesh("cap", *with_slid_vertex(*sound, 3.0)))
    assert "whether cap is so where triangles fold back over their neighbours" in said
    assert not folds(checked_mesh("ball", *with_slid_vertex(*ball_mesh(20.0, 1.2), 3.0))), "closed: no harm in it"


@pytest.mark.parametrize(
    "sound",
    [
        torus_mesh(18.0, 12.0, 1.2),
        cap_mesh(20.0, 1.2, 0.5),
        shell_mesh(16.4, 17.4, 2.0, 1.3, [0.0, 1.0, 0.0]),
        slab_mesh(*sheet_mesh(14.0, 0.7), 1.2),
        (trimesh.creation.box((60.0, 10.0, 60.0)).vertices, trimesh.creation.box((60.0, 10.0, 60.0)).faces),
    ],
)
def test_rims_and_corners_of_sound_bodies_are_no_spikes(sound):
    assert not spikes(checked_mesh("sound", *sound))


@pytest.mark.parametrize("body", [ball_mesh(20.0, 1.5), sheet_mesh(40.0, 1.0)])
def test_a_hole_is_told_and_where_the_rim_of_an_open_surface_is_none(body):
    points, faces = body
    assert not holes(checked_mesh("sound", points, faces))
    place = points[np.linalg.norm(points - [0.0, 20.0, 0.0], axis=1).argmin()]
    away = np.linalg.norm(points[faces].mean(axis=1) - place, axis=1) > 2.0
    (said,) = holes(checked_mesh("holed", points, faces[away]))
    assert "has holes (1, " in said
    assert 2.0 < float(said.split("the widest ")[1].split(" mm")[0]) < 8.0
    assert f"({place[0].round(1) + 0.0:.4g}, " in said
