"""At creases each side of a mesh keeps its own normals, and what lies outside stays outside."""

import numpy as np

from casadi_contact.geometry.distance_field import build_field
from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.smooth_surface import SmoothSurface
from tests.support.meshes import revolved

HALF_MM = np.array([12.0, 5.0, 8.0])


def box_mesh():
    """Twelve triangles of a CAD file, as long as its walls."""
    corners = HALF_MM * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return checked_mesh("box", corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]))


def box_distance(points):
    beyond = np.abs(points) - HALF_MM
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def dish_mesh(rim_mm=9.0, radius_mm=11.0, low_mm=-21.0):
    """A round part with a spherical dish in its top, a sharp rim, and a wall in single triangles from top to bottom."""
    r = np.linspace(rim_mm, 0.0, 26)
    profile = [(0.0, low_mm), (rim_mm, low_mm), *zip(r, -np.sqrt(radius_mm**2 - r**2), strict=True)]
    return checked_mesh("dish", *revolved(profile, 96))


def test_the_distance_of_a_box_from_points_all_around_it():
    points = np.random.default_rng(0).uniform(-1.4, 1.4, (20_000, 3)) * HALF_MM
    exact, found = box_distance(points), SmoothSurface(box_mesh()).distance(points)
    over_a_side = ((np.abs(points) > HALF_MM).sum(axis=1) <= 1) & (np.abs(exact) > 1e-9)
    np.testing.assert_allclose(found[over_a_side], exact[over_a_side], atol=1e-9)
    np.testing.assert_array_equal(np.sign(found), np.sign(exact))
    assert np.abs(found / exact - 1.0).max() < 0.1  # past an edge, where the fan begins


def test_nothing_is_solid_beside_the_sharp_rim_of_a_part_with_long_triangles():
    points = np.array([[x, y, 0.0] for y in (-6.0, -5.0, -3.0, 0.0) for x in (7.5, 8.6, 9.0, 9.4, 11.0)])
    rim = np.array([9.0, -np.sqrt(11.0**2 - 9.0**2), 0.0])
    values, _ = build_field(dish_mesh(), 0.45)(points)
    above_the_dish = points[:, 0] < 9.0 / rim[1] * points[:, 1]  # whose middle is the origin
    exact = np.where(above_the_dish, 11.0 - np.linalg.norm(points, axis=1), np.linalg.norm(points - rim, axis=1))
    np.testing.assert_allclose(values, exact, rtol=0.1, atol=0.05)
