"""Projections of surfaces onto a plane: their derivatives, and that areas are what they say."""

from functools import partial

import numpy as np
import pytest
import trimesh

from casadi_contact.geometry.distance_field import build_field
from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.geometry.projection import (
    DOWN,
    CentralProjection,
    ParallelProjection,
    grid_frame,
    grid_on_mesh,
    projection_of,
)
from casadi_contact.geometry.smooth_surface import SmoothSurface
from tests.support.meshes import sheet_mesh, shell_mesh

FRAME = grid_frame([0.3, 0.8, 0.2])
CENTRE = np.array([1.0, 2.0, 3.0])
PROJECTIONS = [ParallelProjection(FRAME), CentralProjection(FRAME, CENTRE, 16.0)]
STEP_MM = 1e-5


@pytest.fixture
def places():
    """To 130 degrees from the pole of a cup of 16 mm."""
    return np.random.default_rng(0).uniform(-20.0, 20.0, (2, 40))


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_slopes_and_bends_of_lines_are_their_derivatives(projection, places):
    lines = projection.lines(*places)
    np.testing.assert_allclose(np.linalg.norm(lines.ups, axis=1), 1.0, atol=1e-12)
    for axis in range(2):
        step = STEP_MM * np.eye(2)[axis][:, None]
        ahead, behind = projection.lines(*(places + step)), projection.lines(*(places - step))
        derivatives = {"starts": "start_gradients", "ups": "up_gradients", "up_gradients": "up_hessians"}
        for value, gradient in ((name, getattr(lines, of)) for name, of in derivatives.items()):
            difference = (getattr(ahead, value) - getattr(behind, value)) / (2.0 * STEP_MM)
            np.testing.assert_allclose(gradient[:, axis], difference, atol=1e-9)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_area_across_the_lines_is_the_plane_s_times_the_spread(projection, places):
    lines = projection.lines(*places)
    h = np.random.default_rng(1).uniform(-30.0, -5.0, len(lines.ups))
    along_u, along_v = np.moveaxis(lines.start_gradients + h[:, None, None] * lines.up_gradients, 1, 0)
    across = np.einsum("nk,nk->n", np.cross(along_v, along_u), lines.ups)
    np.testing.assert_allclose(across, projection.spread(h), rtol=1e-9)


def test_a_grid_covers_all_of_a_coarse_ball_that_faces_it():
    """Of 320 triangles, whose middles lie up to 0.56 mm below the sphere, along steep lines 1 mm and more."""
    ball, down = trimesh.creation.icosphere(subdivisions=2, radius=24.0), ParallelProjection(grid_frame(DOWN))
    mesh, everywhere = checked_mesh("ball", ball.vertices, ball.faces), (np.full(3, -np.inf), np.full(3, np.inf))
    centres, _, areas = grid_on_mesh(mesh, build_field(mesh), (80, 80), everywhere, down, partial(SmoothSurface, mesh))
    above = (areas > 0.0) & (centres[..., 1] > 12.0)  # within 60 degrees of the pole
    assert areas[above].sum() == pytest.approx(np.pi * 24.0**2, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(centres[above], axis=-1), 24.0, atol=0.04)


def test_the_middle_of_a_cup_is_seen_from_its_inside():
    cup = checked_mesh("cup", *shell_mesh(16.4, 22.0, 3.0, 1.2, [0.0, 1.0, 0.0]))
    assert projection_of([0.0, 1.0, 0.0], [0.0, 0.0, 0.0], cup).radius_mm == pytest.approx(16.4, abs=1e-6)
    plate = checked_mesh("plate", *sheet_mesh(14.0, 2.0))
    with pytest.raises(ValueError, match="cup_centre"):
        projection_of([0.0, -1.0, 0.0], [0.0, -30.0, 0.0], plate)
