"""Cells are smaller over a ridge of the fixed surface, where spots of contact are narrow."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.charts import density
from casadi_contact.contact.cells.patches import lay_lines
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh

RADIUS_MM, SLOPE, RIDGE_RADIUS_MM = 12.0, 0.7, 1.0


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
    return scene_of(folder, cap_mesh(RADIUS_MM, 0.8, 0.9), fixed, grid=(320, 320))


@pytest.mark.parametrize(("cells", "share"), [(Cells(1.2, 0.85), 0.045), (Cells(0.6, 0.6, 4, 4), 0.008)], ids=str)
def test_a_ridge_carries_what_elements_say(ridge, cells, share):
    """Cells that were as large there as on the flat are off by 6.6 % and by 1.2 %."""
    random = np.random.default_rng(0)
    poses = np.zeros((24, 6))
    poses[:, 0], poses[:, 2] = random.uniform(-2.0, 2.0, 24), random.uniform(-1.0, 1.0, 24)
    poses[:, 1] = RADIUS_MM - random.uniform(0.1, 0.4, 24)
    truth = cc.ElasticFoundation(ridge).wrenches(poses)[:, 0, :3]
    found = cc.CellFoundation(ridge, cells, compiled=False).wrenches(poses)[:, 0, :3]
    assert (np.linalg.norm(found - truth, axis=1) < share * np.linalg.norm(truth, axis=1)).all()
