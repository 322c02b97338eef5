"""Moving surfaces are smooth, convex distances; elements cover the fixed surface."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.geometry.surface_distances import signed_distance
from tests.support.agreement import differences


def distance(surface, points):
    return np.array([signed_distance(surface.family, surface.parameters, *p) for p in points])


def near_the_condyle(rng, n):
    """Points below and around a condyle, where an insert can be."""
    flexion, radius = rng.uniform(-0.5, 1.9, n), rng.uniform(15.0, 60.0, n)
    return np.c_[radius * np.sin(flexion), -radius * np.cos(flexion), 22.0 + rng.uniform(-12.0, 12.0, n)]


def test_condyle_distance_has_unit_gradient_that_matches_differences():
    surface = cc.load_scene("knee").surfaces()[0]
    points = near_the_condyle(np.random.default_rng(1), 500)
    values = distance(surface, points)
    np.testing.assert_allclose(np.linalg.norm(values[:, 1:], axis=1), 1.0, atol=1e-12)
    slopes = differences(lambda at: distance(surface, at)[:, 0], points, 1e-6)
    np.testing.assert_allclose(slopes, values[:, 1:], atol=1e-7)


def test_condyle_distance_is_convex_as_culling_needs():
    surface = cc.load_scene("knee").surfaces()[0]
    rng = np.random.default_rng(2)
    a, b = near_the_condyle(rng, 4000), near_the_condyle(rng, 4000)
    middle = distance(surface, 0.5 * (a + b))[:, 0]
    assert np.all(middle <= 0.5 * (distance(surface, a)[:, 0] + distance(surface, b)[:, 0]) + 1e-12)


def test_condyle_arcs_meet_without_a_step_or_a_kink_about_the_moving_origin():
    scene = cc.load_scene("knee")
    surface = scene.surfaces()[0]
    for junction in np.deg2rad(scene.geometry["sagittal_junctions_deg"]):
        sides = [junction - 1e-9, junction + 1e-9]
        near = distance(surface, [[30 * np.sin(f), -30 * np.cos(f), 25.0] for f in sides])
        np.testing.assert_allclose(near[0], near[1], atol=1e-6)
    flexion = np.deg2rad(40.0)  # on the main arc
    point = [27.3 * np.sin(flexion), -27.3 * np.cos(flexion), 22.0]
    assert distance(surface, [point])[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_element_areas_sum_to_the_area_of_the_dish():
    scene = cc.load_scene("sphere_in_dish")
    half, R = 0.5 * scene.geometry["patch_side"], scene.geometry["dish_radius"]
    x, weights = np.polynomial.legendre.leggauss(60)
    X, Z = np.meshgrid(half * x, half * x)
    exact = half**2 * (np.outer(weights, weights) * R / np.sqrt(R**2 - X**2 - Z**2)).sum()
    assert scene.elements((200, 200))[0].areas_mm2.sum() == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("patch", [0, 1])
def test_knee_elements_lie_on_the_dish_with_unit_normals_upwards(patch):
    scene = cc.load_scene("knee")
    elements = scene.elements((31, 17))[patch]
    g = scene.patch_geometry(scene.patch_names[patch])
    x, y, z = (elements.centres_mm - [0.0, 0.0, scene.anchors_mm[patch, 2]]).T
    rho = np.hypot(x, g["dish_sagittal_radius"] - y)
    offset = g["dish_sagittal_radius"] - g["dish_frontal_radius"]
    np.testing.assert_allclose(np.hypot(rho - offset, z), g["dish_frontal_radius"], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(elements.normals, axis=1), 1.0, rtol=1e-12)
    assert np.all(elements.normals[:, 1] > 0.0)
    assert elements.blocks[-1] == 31 * 17
