"""Vertices with very many neighbours: fans of long triangles, as at the poles of spheres and on the ends of drums."""

import tracemalloc

import numpy as np
import pytest

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.smooth_surface import SmoothSurface, fitted_normals
from tests.support.meshes import outward, unit


def pole_mesh(spokes, rings, radius=20.0):
    """The part of a sphere about -y with a fan of triangles at its pole, its rings half a mm apart."""
    polar, azimuth = 0.5 / radius * np.arange(1, rings + 1), 2.0 * np.pi * np.arange(spokes) / spokes
    circle = np.stack([np.cos(azimuth), 0.0 * azimuth, np.sin(azimuth)], axis=1)
    points = np.concatenate([np.sin(p) * circle - [0.0, np.cos(p), 0.0] for p in polar])
    points = radius * np.vstack([[[0.0, -1.0, 0.0]], points])
    k = np.arange(spokes)
    following = (k + 1) % spokes
    faces = [np.stack([0 * k, 1 + k, 1 + following], axis=1)]
    for first in 1 + spokes * np.arange(rings - 1):
        inner, outer = (first + k, first + following), (first + spokes + k, first + spokes + following)
        faces += [np.stack([inner[0], outer[0], inner[1]], axis=1), np.stack([inner[1], outer[0], outer[1]], axis=1)]
    return points, outward(points, np.concatenate(faces), lambda p: p)


@pytest.mark.parametrize("spokes", [40, 300, 1000])
def test_normals_at_a_pole_are_those_of_the_sphere(spokes):
    mesh = checked_mesh("pole", *pole_mesh(spokes, 6))
    inner = np.hypot(mesh.vertices_mm[:, 0], mesh.vertices_mm[:, 2]) < 2.2
    assert np.linalg.norm(fitted_normals(mesh) - unit(mesh.vertices_mm), axis=1)[inner].max() < 1e-3


def drum(spokes):
    """A closed drum whose ends are fans."""
    angle = 2.0 * np.pi * np.arange(spokes) / spokes
    rings = [np.stack([20.0 * np.cos(angle), 0.0 * angle + y, 20.0 * np.sin(angle)], axis=1) for y in (-10.0, 10.0)]
    k, n = 2 + np.arange(spokes), 2 + (np.arange(spokes) + 1) % spokes
    ends = [np.stack([0 * k, k, n], axis=1), np.stack([0 * k + 1, n + spokes, k + spokes], axis=1)]
    wall = [np.stack([k, k + spokes, n], axis=1), np.stack([n, k + spokes, n + spokes], axis=1)]
    return np.vstack([[[0.0, -10.0, 0.0], [0.0, 10.0, 0.0]], *rings]), np.concatenate([*ends, *wall])


def test_memory_grows_with_the_triangles_and_not_with_their_square():
    """The normals of a drum with ends of 2,000 spokes took 2.5 GB."""
    meshes = {spokes: checked_mesh("drum", *drum(spokes)) for spokes in (2000, 4000)}
    peak = {}
    for spokes, mesh in meshes.items():
        tracemalloc.start()
        try:
            surface = SmoothSurface(mesh)
            peak[spokes] = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        np.testing.assert_allclose(surface.distance(np.array([[3.0, 10.5, 4.0], [3.0, -9.0, 4.0]])), [0.5, -1.0], 1e-9)
    assert peak[2000] < 64 << 20
    assert peak[4000] < 2.5 * peak[2000]
