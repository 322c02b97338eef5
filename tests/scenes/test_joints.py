"""Elements of cup and groove lie on their surfaces, cover their areas and face the moving body."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.shapes.shape import shape_named


@pytest.mark.parametrize("grid", [(40, 40), (7, 20)])
@pytest.mark.parametrize("name", ["hip", "glenohumeral"])
def test_a_cup_is_a_cap_of_its_sphere(name, grid):
    g = cc.load_scene(name).geometry
    ((centres, normals, areas),) = shape_named("ball_in_cup").cells(g, grid)
    out = (centres - g["cup_centre"]) / g["cup_radius"]
    np.testing.assert_allclose(normals, -out, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)
    half = np.deg2rad(g["cup_half_angle_deg"])
    assert areas.sum() == pytest.approx(2.0 * np.pi * g["cup_radius"] ** 2 * (1.0 - np.cos(half)))
    angle = np.arccos(out @ (np.array(g["cup_pole"]) / np.linalg.norm(g["cup_pole"])))
    assert angle.max() < half
    rim = np.ones(grid, dtype=bool)
    rim[1:-1, 1:-1] = False
    assert angle[rim].min() > angle[~rim].max() - half / min(grid)  # the outermost elements are the rim


def test_elements_of_a_cup_are_spread_evenly():
    """Equal areas: the mean of a linear function over the elements is that over the cap."""
    g = {**cc.load_scene("hip").geometry, "cup_centre": [0.0, 0.0, 0.0], "cup_pole": [0.0, 1.0, 0.0]}
    ((centres, _, areas),) = shape_named("ball_in_cup").cells(g, (200, 200))
    height = g["cup_radius"] * 0.5 * (1.0 + np.cos(np.deg2rad(g["cup_half_angle_deg"])))
    np.testing.assert_allclose((centres * areas[..., None]).sum((0, 1)) / areas.sum(), [0.0, height, 0.0], atol=1e-3)


def test_facets_of_a_groove_are_tangent_to_their_grids_and_mirrored():
    g = cc.load_scene("patellofemoral").geometry
    medial, lateral = shape_named("button_in_groove").cells(g, (300, 200))
    centres, normals, areas = medial
    along, across = np.gradient(centres, axis=0), np.gradient(centres, axis=1)
    for tangent in (along, across):
        tangent = tangent[1:-1, 1:-1]
        unit = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
        assert np.abs((unit * normals[1:-1, 1:-1]).sum(-1)).max() < 1e-4
    spanned = np.linalg.norm(np.cross(along, across), axis=-1)
    np.testing.assert_allclose(spanned[1:-1, 1:-1], areas[1:-1, 1:-1], rtol=1e-3)
    assert (normals[..., 0] < 0.0).all()  # open to the front
    mirror = np.array([1.0, 1.0, -1.0])
    for mine, other in zip(medial[:2], lateral[:2], strict=True):
        np.testing.assert_allclose(other, mine * mirror)
    middle = (g["groove_radius"], g["facet_offset"])
    rho = np.hypot(centres[..., 0], centres[..., 1])
    assert np.hypot(rho - middle[0], centres[..., 2] - middle[1]).min() < 0.1
