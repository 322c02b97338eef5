"""Vertices with very many neighbours: fans of long triangles, as at the poles of spheres and on the ends of drums."""

import tracemalloc

import numpy as np
import pytest

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.smooth_surface import SmoothSurface, fitted_normals
from tests.support.meshes import revolved, unit


@pytest.mark.parametrize("spokes", [40, 300, 1000])
def test_normals_at_a_pole_are_those_of_the_sphere(spokes):
    """A sphere of 20 mm about -y with a fan of triangles at its pole, its rings half a mm apart."""
    polar = np.arange(7) * 0.5 / 20.0
    mesh = checked_mesh("pole", *revolved(20.0 * np.stack([np.sin(polar), -np.cos(polar)], axis=1), spokes))
    inner = np.hypot(mesh.vertices_mm[:, 0], mesh.vertices_mm[:, 2]) < 2.2
    assert np.linalg.norm(fitted_normals(mesh) - unit(mesh.vertices_mm), axis=1)[inner].max() < 1e-3


def test_memory_grows_with_the_triangles_and_not_with_their_square():
    """The normals of a drum with ends of 2,000 spokes took 2.5 GB."""
    ends = [(0.0, -10.0), (20.0, -10.0), (20.0, 10.0), (0.0, 10.0)]
    meshes = {spokes: checked_mesh("drum", *revolved(ends, spokes)) for spokes in (2000, 4000)}
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
