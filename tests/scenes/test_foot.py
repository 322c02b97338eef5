"""A sole: its surface and derivatives, its contact with the ground in elements and cells, what is refused."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.charts import SoleChart
from casadi_contact.scenes.shapes.shape import shape_named
from tests.support.compiler import needs_compiler

FLAT_HEEL_TOES = np.array([[0.0, -25.0, 0.0, rx, 0.0, rz] for rx, rz in ((0.0, 0.0), (0.05, -0.35), (0.0, 0.6))])


@pytest.fixture(scope="module")
def foot():
    return cc.load_scene("foot_on_ground")


def test_normals_and_their_slopes_are_those_of_the_surface(foot):
    chart, step = SoleChart(foot.geometry), 1e-4
    u, v = np.array([-20.0, 3.0, 90.0, 150.0, 200.0, 240.0]), np.array([-40.0, 10.0, 0.0, 30.0, 20.0, -44.0])
    here = chart.surface(u, v)
    for axis, move in enumerate(((step, 0.0), (0.0, step))):
        ends = [chart.surface(u + way * move[0], v + way * move[1]) for way in (1.0, -1.0)]
        np.testing.assert_allclose((ends[0].c - ends[1].c) / (2.0 * step), here.tangents[:, axis], atol=1e-7)
        np.testing.assert_allclose((ends[0].n - ends[1].n) / (2.0 * step), here.bends[:, axis], atol=1e-7)
        np.testing.assert_allclose(np.einsum("nk,nk->n", here.n, here.tangents[:, axis]), 0.0, atol=1e-12)
    assert (here.n[:, 1] < 0.0).all()


def test_elements_cover_the_sole_with_their_normals(foot):
    shape = shape_named("foot_on_ground")
    (coarse,), (fine,) = (shape.cells(foot.geometry, grid) for grid in ((60, 30), (240, 120)))
    assert coarse[2].sum() == pytest.approx(fine[2].sum(), rel=1e-3)
    np.testing.assert_allclose(np.linalg.norm(fine[1], axis=-1), 1.0)
    assert fine[0][..., 1].min() == pytest.approx(-foot.geometry["depth"], abs=0.6)


@needs_compiler
def test_cells_carry_what_elements_do_flat_on_the_heel_and_on_the_toes(foot):
    elements, cells = cc.ElasticFoundation(foot), cc.CellFoundation(foot, Cells(7.2, 7.2, 8, 8))
    poses, _ = cc.settle(elements, FLAT_HEEL_TOES, ["ty"], {"Fy": np.full(3, 500.0)})
    expected = elements(poses)
    assert (np.abs(cells(poses) - expected) < foot.tolerances_of()).all()
    flat, heel, toes = expected[:, 5] / expected[:, 1]  # centre of pressure along the foot
    assert heel < 30.0 < flat < 150.0 < toes
    assert not cells([0.0, -26.0, 0.0, 0.0, 0.0, 0.0]).any()


def test_a_sole_that_ends_before_it_begins_is_refused(foot):
    with pytest.raises(ValueError, match="rising"):
        foot.with_overrides(toe_x=-30.0)
