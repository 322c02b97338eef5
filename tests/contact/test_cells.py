"""Cubic cells in NumPy: closed forms, agreement with fine element grids, several spots, and the choice of a size."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells, hermite_functions, middles, ramp
from casadi_contact.contact.elements.loops import point_distances
from casadi_contact.core.conventions import rotation
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh
from tests.support.ready_poses import at

RADIUS_MM = 30.0
TWO_BUMPS_MM = 6.0  # of each from the middle


def cells(name, size=Cells(1.2, 1.2), **overrides):  # noqa: B008
    return cc.CellFoundation(cc.load_scene(name, **overrides), size, compiled=False)


def bumps(x, z):
    return sum(0.9 * np.exp(-((x - middle) ** 2 + z**2) / 8.0) for middle in (-TWO_BUMPS_MM, TWO_BUMPS_MM))


@pytest.fixture(scope="module")
def ball_mesh(tmp_path_factory):
    """A meshed ball on a plate with two shallow bumps: it touches each in a spot of its own."""
    moving = cap_mesh(RADIUS_MM, 1.5, 0.5)
    return scene_of(tmp_path_factory.mktemp("bumps"), moving, sheet_mesh(20.0, 0.8, bumps), grid=(160, 160))


def test_cells_that_carry_are_near_enough_to_be_looked_at(tmp_path):
    """On a step with fillets, where interpolation is at its worst: kernels skip cells farther away than `touch_mm`."""
    size = Cells(2.4, 2.4)
    step = sheet_mesh(20.0, 0.8, lambda x, _z: 0.5 * np.tanh((x - 1.0) / 0.8))
    model = cc.CellFoundation(scene_of(tmp_path, cap_mesh(RADIUS_MM, 1.5, 0.5), step), size, compiled=False)
    (patch,) = model.patches
    at = patch.patch
    values = np.concatenate([at.c[:, None], at.tangents], 1)[at.corners].reshape(-1, 12, 3)
    points = np.concatenate([np.einsum("jr,kji->kri", hermite_functions(size), values), at.c[at.corners]], 1)
    away = np.array([3.0, 0.3, 3.0, 0.1, 0.3, 0.1]) * np.random.default_rng(0).uniform(-1.0, 1.0, (12, 6))
    carried = 0
    for pose in np.array([0.0, RADIUS_MM, 0.0, 0.0, 0.0, 0.0]) + away:
        R, t = rotation(pose[3:]), pose[:3]
        touch = patch.touch(R, t)
        carries = touch.cells[(touch.depth > -patch.tuning.width).any(axis=1)]
        g = point_distances(patch.body.family, patch.body.parameters, points[carries].reshape(-1, 3), R, t)
        assert (g.reshape(-1, points.shape[1]).min(axis=1) < patch.tuning.touch_mm(size)).all()
        carried += len(carries)
    assert carried > 40


def test_at_the_brink_of_contact_loads_fade_out_and_never_pull():
    model = cells("sphere_on_plane")
    loads = model(np.vstack([at(30.0 + height) for height in np.linspace(-0.02, 0.03, 60)]))[:, 1]
    assert (loads <= 0.0).all()
    assert (np.diff(loads) >= 0.0).all()
    assert loads[0] < -5.0
    assert loads[-1] == 0.0
    pressed, apart = model.pressures(np.vstack([at(29.98), at(30.03)]))[0]
    assert (pressed[[0, 1, 2, 6]] > 0.0).all()
    assert not apart[[0, 1, 2, 6]].any()
    assert np.isnan(apart[3:6]).all()


def test_two_spots_on_a_mesh_carry_what_a_fine_element_grid_says(ball_mesh):
    model = cc.CellFoundation(ball_mesh, Cells(0.8, 0.8), compiled=False)
    fine = cc.ElasticFoundation(ball_mesh, (160, 160))
    poses = np.array([[0.0, RADIUS_MM + 0.1, 0.0, 0.0, 0.0, 0.0], [0.5, RADIUS_MM + 0.05, 0.0, 0.0, 0.0, 0.02]])
    force = -fine(poses)[:, 1]
    assert force.min() > 50.0
    np.testing.assert_allclose(-model(poses)[:, 1], force, rtol=0.02)
    np.testing.assert_allclose(model.gaps(poses), fine.gaps(poses), atol=0.03)
    found, wanted = model.summary(poses), fine.summary(poses)
    np.testing.assert_allclose(found.area_mm2, wanted.area_mm2, rtol=0.03)
    np.testing.assert_allclose(found.largest_mpa, wanted.largest_mpa, rtol=0.03)
    np.testing.assert_allclose(found.centre_mm, wanted.centre_mm, atol=0.1)
    loaded = fine.pressure_maps(poses[0])[0]
    along = loaded.centres_mm[loaded.pressures_mpa > 0.0, 0]
    assert along.min() < -0.5 * TWO_BUMPS_MM < 0.5 * TWO_BUMPS_MM < along.max()
    assert not (np.abs(along) < 0.25 * TWO_BUMPS_MM).any()


def test_a_cell_s_cubic_keeps_the_values_and_slopes_of_a_quadratic():
    size = Cells(1.0, 1.0, 5, 3)
    xi, eta = np.meshgrid(middles(5), middles(3), indexing="ij")

    def quadratic(x, y):
        return 1.0 + 2.0 * x - y + 0.5 * x * x + 0.7 * y * y, 2.0 + x, -1.0 + 1.4 * y

    corners = np.concatenate([quadratic(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)])
    np.testing.assert_allclose(corners @ hermite_functions(size), quadratic(xi, eta)[0].ravel(), atol=1e-12)


def test_the_smooth_ramp_joins_its_branches_and_has_no_second_moment():
    x = np.linspace(-0.05, 0.05, 20001)
    value, slope = ramp(x, 0.02)
    np.testing.assert_allclose(np.gradient(value, x)[1:-1], slope[1:-1], atol=1e-4)
    assert (value[x < -0.02] == 0.0).all()
    np.testing.assert_array_equal(value[x > 0.02], x[x > 0.02])
    missed = (value - np.maximum(x, 0.0)).sum() * (x[1] - x[0])
    assert abs(missed) < 1e-9  # a quadratic ramp of this width misses 7e-5
