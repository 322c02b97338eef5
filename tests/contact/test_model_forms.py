"""One model in several forms: CasADi functions, loads and roots at once, material and placement as inputs."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.model import NamedLoads
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import rotation
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import KNEE

POSE = np.array([0.3, 29.8, -0.2, 0.05, 0.1, -0.2])


@pytest.fixture(scope="module")
def elements():
    return cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20))


def test_a_model_called_back_has_its_own_values_and_derivatives(elements):
    model = symbolic(elements)
    names = ("Fy", "Tx")
    columns = [elements.load_names.index(name) for name in names]
    pose = ca.MX.sym("pose", 6)
    loads, roots = model.load_and_root_function(names)(pose)
    slopes = ca.Function("slopes", [pose], [loads, ca.jacobian(loads, pose), roots, ca.jacobian(roots, pose)])
    value, slope, root, root_slope = (np.asarray(part) for part in slopes(POSE))
    expected, expected_slope = elements.jacobian(POSE)
    np.testing.assert_allclose(value.ravel(), expected[columns], rtol=1e-14)
    np.testing.assert_allclose(slope, expected_slope[columns], rtol=1e-14)
    expected_root, expected_root_slope = elements.root_loads(POSE)
    np.testing.assert_allclose(root.ravel(), expected_root, rtol=1e-14)
    np.testing.assert_allclose(root_slope, expected_root_slope, rtol=1e-14)
    np.testing.assert_array_equal(model(POSE, names), expected[columns])
    assert np.asarray(model.function(batch=3)(np.tile(POSE[:, None], 3))).shape == (len(elements.load_names), 3)
    assert symbolic(model) is model
    with pytest.raises(ValueError, match="loads Fy_med, expected some of "):
        model.function("Fy_med")


MODELS = {
    "polar quadrature": lambda: cc.PolarFoundation(cc.load_scene("knee")),
    "polar quadrature in NumPy": lambda: cc.PolarFoundation(cc.load_scene("knee"), compiled=False),
    "surrogate": lambda: cc.load_surrogate("knee"),
    "elements by other loads": lambda: NamedLoads(cc.ElasticFoundation(cc.load_scene("knee"), (40, 20)), ["Tx_lat"]),
}


@pytest.mark.parametrize("kind", MODELS)
def test_together_they_are_what_they_are_alone(kind):
    model, poses = MODELS[kind](), np.array([[0.0, 27.0, 0.2, 0.01, 0.0, -0.3], [0.0, 29.5, 0.0, 0.03, 0.0, -0.6]])
    apart = (*model.jacobian(poses), *model.root_loads(poses))
    for one, two in zip(model.jacobian_and_roots(poses), apart, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())


PLACEMENT = [f"fixed_{name}" for name in ("tx", "ty", "tz", "rx", "ry", "rz")]
MATERIAL = {"youngs_modulus": 800.0, "poissons_ratio": 0.4, "thickness": 6.0}


@pytest.fixture(scope="module")
def knee():
    return cc.PolarFoundation(cc.load_scene("knee"))


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])
def test_a_material_given_as_inputs_gives_the_loads_of_the_scene_with_that_material(knee, compiled):
    f = knee.load_and_root_function(parameters=MATERIAL, compiled=compiled)
    other = cc.PolarFoundation(cc.load_scene("knee", **MATERIAL), knee.rays, compiled=False)
    for pose in (np.array(KNEE), np.array(KNEE) + 5.0 * np.eye(6)[1]):
        for got, expected in zip(
            f(pose, list(MATERIAL.values())), (other(pose), other.root_loads(pose)[0]), strict=True
        ):
            np.testing.assert_allclose(np.array(got)[:, 0], expected, rtol=1e-9)


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
    return np.concatenate([R_f @ pose[:3] + place[:3], Rotation.from_matrix(R_f @ R).as_euler("XYZ")])


def test_moving_both_bodies_together_moves_the_loads_with_them(knee):
    place = np.array([3.0, -2.0, 5.0, 0.2, -0.1, 0.3])
    f = knee.load_and_root_function(parameters=PLACEMENT, compiled=False)
    loads, roots = (np.array(part)[:, 0] for part in f(moved(KNEE, place), place))
    got = dict(zip(knee.load_names, loads, strict=True))
    total = knee.wrenches(np.array([KNEE]))[0].sum(axis=0)
    force = rotation(place[3:]) @ total[:3]
    torque = rotation(place[3:]) @ total[3:] + np.cross(place[:3], force)
    np.testing.assert_allclose([got["Fx"], got["Fz"]], force[[0, 2]], atol=1e-7)
    assert got["Fy_med"] + got["Fy_lat"] == pytest.approx(force[1], rel=1e-9)
    np.testing.assert_allclose([got["Tx"], got["Ty"], got["Tz"]], torque, atol=1e-5)
    np.testing.assert_allclose(-knee.scene.reference_load * roots**2, [got["Fy_med"], got["Fy_lat"]], rtol=1e-9)


@needs_compiler
@pytest.mark.parametrize("roots", [False, True])
def test_first_and_second_derivatives_by_all_inputs_are_those_of_the_loads(knee, roots):
    """Against differences; an angle and Poisson's ratio are of another size than the rest."""
    names = [*MATERIAL, *PLACEMENT]
    f = knee.root_function(parameters=names) if roots else knee.function(["Fy_med", "Tx"], parameters=names)
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


@pytest.mark.parametrize("model", [cc.ElasticFoundation, cc.PolarFoundation, cc.CupFoundation])
def test_a_name_in_place_of_a_scene_is_told(model):
    with pytest.raises(TypeError, match="load_scene"):
        model("knee")
