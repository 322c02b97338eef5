"""Material and placement of the fixed body as inputs: other scenes' loads, rigid motions, derivatives."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import rotation
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import KNEE

PLACEMENT = [f"fixed_{name}" for name in ("tx", "ty", "tz", "rx", "ry", "rz")]
MATERIAL = {"youngs_modulus": 800.0, "poissons_ratio": 0.4, "thickness": 6.0}


@pytest.fixture(scope="module")
def knee():
    return cc.PolarFoundation(cc.load_scene("knee"), Rays(12, 3))


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])
def test_a_material_given_as_inputs_gives_the_loads_of_the_scene_with_that_material(knee, compiled):
    f = knee.function(parameters=MATERIAL, compiled=compiled)
    other = cc.PolarFoundation(cc.load_scene("knee", **MATERIAL), knee.rays, compiled=False)
    np.testing.assert_allclose(np.array(f(KNEE, list(MATERIAL.values())))[:, 0], other(np.array(KNEE)), rtol=1e-9)


@pytest.mark.parametrize("wrong", [{"youngs_modulus": 0.0}, {"youngs_modulus": -5.0}, {"thickness": 0.0},
                                   {"thickness": -7.0}, {"poissons_ratio": 0.5}, {"poissons_ratio": 0.7},
                                   {"poissons_ratio": -1.0}])  # fmt: skip
def test_a_material_that_cannot_be_has_no_loads_and_the_slopes_of_one_that_can_are_finite(knee, wrong):
    f = knee.function(parameters=MATERIAL, compiled=False)
    assert np.isnan(np.array(f(KNEE, list({**MATERIAL, **wrong}.values())))).all()
    q = ca.MX.sym("q", len(MATERIAL))
    slopes = ca.Function("slopes", [q], [ca.jacobian(f(ca.DM(KNEE), q), q)])
    assert np.isfinite(np.array(slopes(list(MATERIAL.values())))).all()


def moved(pose, place):
    """The pose after both bodies went with the fixed one to its place."""
    R_f, R = rotation(place[3:]), rotation(pose[3:])
    R = R_f @ R
    angles = [np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0])]
    return np.concatenate([R_f @ pose[:3] + place[:3], angles])


def test_moving_both_bodies_together_moves_the_loads_with_them(knee):
    place = np.array([3.0, -2.0, 5.0, 0.2, -0.1, 0.3])
    f = knee.function(parameters=PLACEMENT, compiled=False)
    loads = np.array(f(moved(KNEE, place), place))[:, 0]
    got = dict(zip(knee.load_names, loads, strict=True))
    total = knee.wrenches(np.array([KNEE]))[0].sum(axis=0)
    force = rotation(place[3:]) @ total[:3]
    torque = rotation(place[3:]) @ total[3:] + np.cross(place[:3], force)
    np.testing.assert_allclose([got["Fx"], got["Fz"]], force[[0, 2]], atol=1e-7)
    assert got["Fy_med"] + got["Fy_lat"] == pytest.approx(force[1], rel=1e-9)
    np.testing.assert_allclose([got["Tx"], got["Ty"], got["Tz"]], torque, atol=1e-5)


@needs_compiler
def test_first_and_second_derivatives_by_all_inputs_are_those_of_the_loads(knee):
    """Against differences; an angle and Poisson's ratio are of another size than the rest."""
    names = [*MATERIAL, *PLACEMENT]
    f = knee.function(["Fy_med", "Tx"], parameters=names)
    x, q = ca.MX.sym("x", 6), ca.MX.sym("q", len(names))
    both, total = ca.vertcat(x, q), ca.dot(ca.DM([1.0, 0.05]), f(x, q))
    gradient = ca.Function("gradient", [both], [ca.gradient(total, both)])
    value = ca.Function("value", [both], [total])
    hessian = ca.Function("hessian", [both], [ca.hessian(total, both)[0]])
    at = np.array([*KNEE, 500.0, 0.44, 7.0, 0.1, 0.02, -0.1, 0.002, 0.01, -0.02])
    steps = np.array([*np.repeat([1e-5, 4e-7], 3), 1e-2, 1e-5, 1e-4, *np.repeat([1e-5, 4e-7], 3)])
    first = np.array([float(value(at + m) - value(at - m)) for m in np.diag(steps)]) / (2.0 * steps)
    scaled = np.array(gradient(at))[:, 0] * steps
    np.testing.assert_allclose(scaled, first * steps, atol=1e-4 * np.abs(scaled).max())
    second = np.column_stack([np.array(gradient(at + m) - gradient(at - m))[:, 0] for m in np.diag(steps)])
    square = np.array(hessian(at)) * np.outer(steps, steps)
    np.testing.assert_allclose(square, 0.5 * second * steps[:, None], atol=3e-3 * np.abs(square).max())
