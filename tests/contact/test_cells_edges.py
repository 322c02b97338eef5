"""Pressures of cubic cells where a sharp edge of the moving body presses: a cylinder that leans on its edge."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from tests.support.agreement import check_hessians, check_jacobian
from tests.support.compiler import needs_compiler
from tests.support.meshes import scene_of, sheet_mesh, wheel_mesh

RADIUS_MM, HALF_WIDTH_MM = 15.0, 6.0
SIZES = (Cells(2.4, 0.85, 8, 3), Cells(1.2, 1.2, 4, 4), Cells(0.6, 0.6, 3, 3))
LEANS_RAD, OVERLAPS_MM, BESIDE_MM = (0.1, 0.2, 0.4), (0.3, 0.6, 1.0, 2.0), (0.1, 0.45)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The edge passes between nodes and over them, from poses where it is shallow to those where it is deep."""
    moving = wheel_mesh(RADIUS_MM, HALF_WIDTH_MM, 1.0)
    scene = scene_of(tmp_path_factory.mktemp("wheel"), moving, sheet_mesh(24.0, 2.0), grid=(320, 320))
    poses = []
    for lean in LEANS_RAD:
        reach = RADIUS_MM * np.cos(lean) + HALF_WIDTH_MM * np.sin(lean)
        poses += [[0.3, reach - overlap, z, lean, 0.0, 0.0] for overlap in OVERLAPS_MM for z in BESIDE_MM]
    return scene, np.array(poses)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_peak_beside_an_edge_is_what_depths_there_allow(wheel, size):
    """Cubics between depths that jump at the edge rise up to 2.4 times too high. Depth grows towards the edge, which
    may lie as much as a cell beyond the last corner that faces the plate: the peak of large cells is too low."""
    scene, poses = wheel
    truth = cc.ElasticFoundation(scene).summary(poses)
    found = cc.CellFoundation(scene, size, compiled=False).summary(poses)
    for got, expected in ((found.largest_mpa, truth.largest_mpa), (found.penetration_mm, truth.penetration_mm)):
        ratio = got / expected
        assert ratio.max() < 1.13
        assert size != SIZES[-1] or ratio.min() > 0.8


@needs_compiler
def test_c_and_numpy_are_the_same_formulas_beside_an_edge(wheel):
    scene, poses = wheel
    compiled, plain = (cc.CellFoundation(scene, SIZES[1], compiled=c) for c in (True, False))
    for a, b in zip(compiled.pressure_moments(poses), plain.pressure_moments(poses), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


@needs_compiler
def test_derivatives_beside_an_edge_are_those_of_the_value(wheel):
    """There a second look at the depth finds the surface turned, and where it is taken moves with the pose."""
    scene, poses = wheel
    model = cc.CellFoundation(scene, SIZES[1])
    check_jacobian(model, poses, 1e-6)
    check_hessians(model, poses, 1e-4, 1e-3)
