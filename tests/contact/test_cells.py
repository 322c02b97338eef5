"""Cubic cells: closed forms, agreement with fine element grids, ridges, several spots, sharp edges."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells, hermite_functions, middles, ramp
from casadi_contact.contact.cells.charts import density
from casadi_contact.contact.cells.patches import lay_lines
from casadi_contact.contact.elements.loops import point_distances
from casadi_contact.core.conventions import rotation
from tests.support.agreement import check_hessians, check_jacobian
from tests.support.compiler import needs_compiler
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh, wheel_mesh
from tests.support.ready_poses import at

RADIUS_MM = 30.0
TWO_BUMPS_MM = 6.0  # of each from the middle


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
        g = point_distances(
            patch.body.family, patch.body.parameters, np.ascontiguousarray(points[carries].reshape(-1, 3).T), R, t
        )
        assert (g.reshape(-1, points.shape[1]).min(axis=1) < patch.tuning.touch_mm(size)).all()
        carried += len(carries)
    assert carried > 40


def test_at_the_brink_of_contact_loads_fade_out_and_never_pull():
    model = cc.CellFoundation(cc.load_scene("sphere_on_plane"), Cells(1.2, 1.2), compiled=False)
    poses = np.vstack([at(30.0 + height) for height in np.linspace(-0.02, 0.03, 60)])
    loads, (areas, means) = model(poses)[:, 1], model.pressures(poses)[0][:, :2].T
    np.testing.assert_allclose(areas * means, -loads, rtol=1e-9, atol=1e-12)  # normals of a plane are parallel
    alone = [model.patches[0].wrench_and_cut(rotation(pose[3:]), pose[:3])[0][1] for pose in poses]
    np.testing.assert_allclose(alone, loads, atol=1e-12)
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


BALL_MM, SLOPE, RIDGE_RADIUS_MM = 12.0, 0.7, 1.0


def test_lines_span_the_side_and_lie_closer_where_the_density_is_higher():
    places = np.linspace(-5.0, 25.0, 301)
    densities = density(np.where(np.abs(places - 10.0) < 1.0, 1.0, 0.0))
    lines = lay_lines(-5.0, 25.0, 0.8, densities, 3)
    widths = np.diff(lines.places)
    np.testing.assert_allclose(lines.places[[0, -1]], [-5.0, 25.0], atol=1e-12)
    assert (np.abs(np.diff(widths)) < 0.2 * widths[1:]).all()
    assert widths[0] == pytest.approx(widths[-1], rel=1e-6) == pytest.approx(0.8, rel=0.05)
    assert np.abs(lines.places[widths.argmin()] - 10.0) < 1.0
    assert widths.min() < 0.7 * widths[0]
    np.testing.assert_allclose(lines.sizes[1:-1], 0.5 * (widths[1:] + widths[:-1]), rtol=0.01)  # their derivative
    sub_points = lines.sub_points.reshape(-1, 3)
    assert (np.diff(lines.sub_points) > 0.0).all()
    assert (sub_points[:, 0] > lines.places[:-1]).all()
    assert (sub_points[:, 2] < lines.places[1:]).all()


@pytest.fixture(scope="module")
def ridge(tmp_path_factory):
    """A ball above a ridge along x, a hyperbola that falls by 35° to both sides."""
    across = SLOPE * RIDGE_RADIUS_MM
    fixed = sheet_mesh(12.0, 0.25, lambda x, z: SLOPE * (across - np.sqrt(z**2 + across**2)))
    folder = tmp_path_factory.mktemp("ridge")
    return scene_of(folder, cap_mesh(BALL_MM, 0.8, 0.9), fixed, grid=(320, 320))


@pytest.mark.parametrize(("cells", "share"), [(Cells(1.2, 0.85), 0.045), (Cells(0.6, 0.6, 4, 4), 0.008)], ids=str)
def test_a_ridge_carries_what_elements_say(ridge, cells, share):
    """Cells that were as large there as on the flat are off by 6.6 % and by 1.2 %."""
    random = np.random.default_rng(0)
    poses = np.zeros((24, 6))
    poses[:, 0], poses[:, 2] = random.uniform(-2.0, 2.0, 24), random.uniform(-1.0, 1.0, 24)
    poses[:, 1] = BALL_MM - random.uniform(0.1, 0.4, 24)
    truth = cc.ElasticFoundation(ridge).wrenches(poses)[:, 0, :3]
    found = cc.CellFoundation(ridge, cells, compiled=False).wrenches(poses)[:, 0, :3]
    assert (np.linalg.norm(found - truth, axis=1) < share * np.linalg.norm(truth, axis=1)).all()


WHEEL_MM, HALF_WIDTH_MM = 15.0, 6.0
SIZES = (Cells(2.4, 0.85, 8, 3), Cells(1.2, 1.2, 4, 4), Cells(0.6, 0.6, 3, 3))
LEANS_RAD, OVERLAPS_MM, BESIDE_MM = (0.1, 0.2, 0.4), (0.3, 0.6, 1.0, 2.0), (0.1, 0.45)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The edge passes between nodes and over them, from poses where it is shallow to those where it is deep."""
    moving = wheel_mesh(WHEEL_MM, HALF_WIDTH_MM, 1.0)
    scene = scene_of(tmp_path_factory.mktemp("wheel"), moving, sheet_mesh(24.0, 2.0), grid=(320, 320))
    poses = []
    for lean in LEANS_RAD:
        reach = WHEEL_MM * np.cos(lean) + HALF_WIDTH_MM * np.sin(lean)
        poses += [[0.3, reach - overlap, z, lean, 0.0, 0.0] for overlap in OVERLAPS_MM for z in BESIDE_MM]
    return scene, np.array(poses)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_peak_beside_an_edge_is_what_depths_there_allow(wheel, size):
    """Cubics between depths that jump at the edge rise up to 2.4 times too high; the peak of large cells is too low."""
    scene, poses = wheel
    truth = cc.ElasticFoundation(scene).summary(poses)
    found = cc.CellFoundation(scene, size, compiled=False).summary(poses)
    for got, expected in ((found.largest_mpa, truth.largest_mpa), (found.penetration_mm, truth.penetration_mm)):
        ratio = got / expected
        assert ratio.max() < 1.13
        assert size != SIZES[-1] or ratio.min() > 0.8


@needs_compiler
def test_beside_an_edge_c_and_numpy_are_the_same_formulas_and_derivatives_those_of_the_value(wheel):
    """There a second look at the depth finds the surface turned, and where it is taken moves with the pose."""
    scene, poses = wheel
    compiled, plain = (cc.CellFoundation(scene, SIZES[1], compiled=c) for c in (True, False))
    for a, b in zip(compiled.pressures(poses), plain.pressures(poses), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    check_jacobian(compiled, poses, 1e-6)
    check_hessians(compiled, poses[::3], 1e-4, 1e-3)
