"""Pressure laws, and area, mean and peak pressure, centre of pressure and penetration of every model."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.pressure_law import compile_laws, law_number, pressure, pressures
from casadi_contact.scenes.material import LAWS
from tests.support.agreement import differences
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import KNEE, PLACES, at, placed

K, H = 2140.0, 8.0


@pytest.mark.parametrize("name", LAWS)
def test_slope_and_curvature_are_derivatives_on_both_sides_of_the_tangent(name):
    step, number = 1e-5, law_number(name)
    for depth in (1e-3, 0.1, 2.0, 0.89 * H, 0.91 * H, 3.0 * H):
        p, slope, curvature = pressure(number, K, H, depth)
        ends = [pressure(number, K, H, depth + way * step) for way in (1.0, -1.0)]
        assert slope == pytest.approx((ends[0][0] - ends[1][0]) / (2.0 * step), rel=1e-7)
        assert curvature == pytest.approx((ends[0][1] - ends[1][1]) / (2.0 * step), rel=1e-6, abs=1e-6 * slope)
        assert p > 0.0


def test_laws_are_their_formulas_and_agree_for_thin_strains():
    depths = np.array([-1.0, 0.0, 0.01, 1.0, 4.0])
    linear, log = (pressures(law_number(name), K, H, depths) for name in ("linear", "log"))
    np.testing.assert_allclose(linear, K * np.maximum(depths, 0.0) / H, rtol=1e-15)
    np.testing.assert_allclose(log, -K * np.log(1.0 - np.maximum(depths, 0.0) / H), rtol=1e-13)
    assert log[2] == pytest.approx(linear[2], rel=1e-3)


def test_a_new_law_is_one_more_function():
    def quadratic(modulus, thickness, depth):
        return modulus * depth**2, 2.0 * modulus * depth, 2.0 * modulus

    compiled = compile_laws([*LAWS.values(), quadratic])
    assert compiled(len(LAWS), 3.0, H, 2.0) == (12.0, 12.0, 6.0)
    for name in LAWS:
        assert compiled(law_number(name), K, H, 1.0) == pressure(law_number(name), K, H, 1.0)


GROOVE = [-49.7, 1.0, 0.3, 0.02, 0.05, 0.1]
ON_PLANE = [1.0, 29.8, -2.0, 0.1, 0.2, 0.3]
FINE = Cells(0.6, 0.6)
LIFTED = [2.0, 27.4, 0.3, 0.01, 0.02, -0.9]  # off laterally


def by_name(model, pose):
    return dict(zip(model.pressure_names, model.pressures(pose)[0], strict=True))


@pytest.mark.parametrize("depth", [0.05, 0.2])
def test_a_sphere_on_a_plane_has_the_closed_forms_of_an_elastic_foundation(depth):
    """Depth d - (R - √(R² - r²)): area π(2Rd - d²), force π(K/h)d²(R - d/3), peak K d/h at the centre of the circle."""
    scene = cc.load_scene("sphere_on_plane")
    model = cc.PolarFoundation(scene, Rays(12, 3), compiled=False)
    got, R = by_name(model, at(30.0 - depth, tx=1.0, tz=-2.0)[0]), 30.0
    stiffness = scene.material.modulus / scene.material.thickness
    area = np.pi * (2.0 * R * depth - depth**2)
    assert got["contact_area"] == pytest.approx(area, rel=1e-4)
    assert got["mean_pressure"] == pytest.approx(np.pi * stiffness * depth**2 * (R - depth / 3.0) / area, rel=1e-4)
    assert got["peak_pressure"] == pytest.approx(stiffness * depth, rel=1e-12)
    assert got["penetration"] == pytest.approx(depth, rel=1e-12)
    np.testing.assert_allclose([got[f"cop_{axis}"] for axis in "xyz"], [1.0, 0.0, -2.0], atol=1e-12)


def test_a_ball_deep_in_a_cup_has_the_closed_forms_of_its_cap():
    """Area 2πR²(1 - x) up to the edge at angle arccos x; peak at the deepest point, along the displacement."""
    scene = cc.load_scene("hip")
    model = cc.CupFoundation(scene, compiled=False)
    pose = placed(scene, [[0.45, 0.1]])[0]
    b = pose[:3] - model.cup.centre
    length, R, r = np.linalg.norm(b), model.cup.radius, model.cup.ball_radius
    edge = (R**2 + length**2 - r**2) / (2.0 * R * length)
    got = by_name(model, pose)
    assert got["contact_area"] == pytest.approx(2.0 * np.pi * R**2 * (1.0 - edge), rel=1e-12)
    assert got["penetration"] == pytest.approx(length + r - R, rel=1e-9)
    stiffness = scene.material.modulus / scene.material.thickness
    assert got["peak_pressure"] == pytest.approx(stiffness * (length + r - R), rel=1e-9)
    along = np.array([got[f"cop_{axis}"] for axis in "xyz"]) - model.cup.centre
    np.testing.assert_allclose(np.cross(along, b), 0.0, atol=1e-9)
    assert 0.5 * (1.0 + edge) * R < np.linalg.norm(along) < R


MODELS = {
    "knee": (lambda c: cc.PolarFoundation(cc.load_scene("knee"), Rays(24, 4), compiled=c), [KNEE, LIFTED]),
    "groove": (lambda c: cc.PolarFoundation(cc.load_scene("patellofemoral"), Rays(24, 4), compiled=c), [GROOVE]),
    "hip": (lambda c: cc.CupFoundation(cc.load_scene("hip"), 24, compiled=c), None),
    "plane": (lambda c: cc.CellFoundation(cc.load_scene("sphere_on_plane"), FINE, compiled=c), [ON_PLANE]),
}


@pytest.fixture(params=MODELS)
def case(request):
    """Makes the model, compiled or not; poses."""
    make, poses = MODELS[request.param]
    model = make(False)
    return make, model, placed(model.scene, PLACES["hip"]) if poses is None else np.array(poses)


def test_they_agree_with_a_fine_element_grid(case):
    _, model, poses = case
    fine, found = (m.summary(poses) for m in (cc.ElasticFoundation(model.scene, (400, 300)), model))
    np.testing.assert_allclose(found.area_mm2, fine.area_mm2, rtol=0.01)
    np.testing.assert_allclose(found.mean_mpa, fine.mean_mpa, rtol=0.01)
    np.testing.assert_allclose(found.largest_mpa, fine.largest_mpa, rtol=0.02, atol=0.01)
    np.testing.assert_allclose(found.penetration_mm, fine.penetration_mm, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(found.centre_mm, fine.centre_mm, atol=0.05)


def test_jacobians_are_the_derivatives_of_the_outputs(case):
    """An angle counts 25 mm to the radian; each output against its own largest slope."""
    _, model, poses = case
    values, slopes = model.pressures(poses)
    scales, loaded = np.repeat([1.0, 25.0], 3), np.isfinite(values)
    found = differences(lambda at: model.pressures(at)[0], poses, 1e-5 / scales)
    size = np.abs(slopes / scales).max(axis=-1, keepdims=True) + 1e-9
    assert (np.abs(slopes - found) / scales / size)[loaded].max() < 2e-3


def test_out_of_contact_they_are_zero_and_there_is_no_centre():
    got = by_name(cc.PolarFoundation(cc.load_scene("knee"), compiled=False), LIFTED)
    assert not any(got[f"{name}_lat"] for name in ("contact_area", "mean_pressure", "peak_pressure", "penetration"))
    assert np.isnan(got["cop_x_lat"])
    assert got["contact_area_med"] > 10.0


@needs_compiler
def test_c_and_numpy_are_the_same_formulas(case):
    make, plain, poses = case
    assert make(True)._pressure_library is not None, "else NumPy is compared with itself"
    for a, b in zip(make(True).pressures(poses), plain.pressures(poses), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(b)))


@needs_compiler
def test_the_compiled_function_is_the_model_s_with_differenced_hessians(case):
    """Also of a patch that is off, whose centre of pressure, NaN, weighs nothing."""
    make, plain, poses = case
    names = [name for name in plain.pressure_names if "cop" not in name]
    pose, weights = ca.MX.sym("pose", 6), np.random.default_rng(0).uniform(0.5, 1.5, len(names))
    outputs = make(True).pressure_function(names)(pose)
    slope = ca.gradient(ca.dot(weights, outputs), pose)
    f = ca.Function("f", [pose], [outputs, ca.jacobian(outputs, pose), slope, ca.jacobian(slope, pose)])
    steps = 1e-4 / np.repeat([1.0, 25.0], 3)
    for place in poses:
        values, jacobian, gradient, hessian = (part.full() for part in f(place))
        for got, wanted in zip((values[:, 0], jacobian), plain.pressures(place, names), strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())
        np.testing.assert_allclose(gradient[:, 0], weights @ jacobian, rtol=1e-9)
        ends = [[(f(place + s * h)[2] / 2e-4).full()[:, 0] for s in (1.0, -1.0)] for h in np.diag(steps)]
        differences = np.column_stack([a - b for a, b in ends]) * np.repeat([1.0, 25.0], 3)
        np.testing.assert_allclose(hessian, 0.5 * (differences + differences.T), atol=1e-4 * np.abs(hessian).max())
