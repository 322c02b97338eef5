"""Load beyond the end of the moving mesh is told, and only there."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.verification.unmodelled_load import share_beyond_open_edges, unmodelled_load_words
from tests.support.meshes import ball_mesh, cap_mesh, mesh_scene_text, sheet_mesh, write_obj


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edges")
    write_obj(folder / "plane.obj", *sheet_mesh(40.0, 2.0))
    write_obj(folder / "ball.obj", *ball_mesh(20.0, 1.2))
    write_obj(folder / "cap.obj", *cap_mesh(20.0, 1.2, 0.5))
    return folder


def model_of(folder, moving):
    path = folder / f"{moving}.toml"
    path.write_text(mesh_scene_text(folder / f"{moving}.obj", folder / "plane.obj"))
    return cc.ElasticFoundation(cc.load_scene(path), (120, 120))


def test_a_cap_that_stands_upright_bears_within_itself_and_one_that_is_turned_onto_its_edge_beyond_it(folder):
    model = model_of(folder, "cap")
    upright = np.array([0.0, 19.9, 0.0, 0.0, 0.0, 0.0])
    tilted = upright + np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0])  # by as much as the cap reaches from its pole
    apart = upright + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    share = share_beyond_open_edges(model, np.array([upright, tilted, apart]))
    assert share[0] == share[2] == 0.0
    assert 0.2 < share[1] < 0.8, "half of the spot lies beyond, where the cap rounds off"
    assert "in 1 of 3 frames up to" in unmodelled_load_words({"beyond_open_edges": share})["beyond_open_edges"]

    many = np.tile([upright, tilted, apart], (150, 1))  # more than are looked up at once
    np.testing.assert_allclose(share_beyond_open_edges(model, many), np.tile(share, 150), rtol=1e-12)


def test_a_closed_body_has_no_open_edges(folder):
    share = share_beyond_open_edges(model_of(folder, "ball"), np.array([[0.0, 19.9, 0.0, 0.5, 0.0, 0.0]]))
    np.testing.assert_array_equal(share, 0.0)
    assert unmodelled_load_words({"beyond_open_edges": share}) == {}


def test_a_parametric_body_has_none():
    model = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (40, 40))
    np.testing.assert_array_equal(share_beyond_open_edges(model, [model.scene.start_pose]), 0.0)
