"""Any contact model as a CasADi function: the same values, its own Jacobian, the same refusals."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.symbolic import symbolic

POSE = np.array([0.3, 29.8, -0.2, 0.05, 0.1, -0.2])


@pytest.fixture(scope="module")
def elements():
    return cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20))


def test_surrogates_and_foundations_are_functions_already():
    for model in (cc.load_surrogate("knee"), cc.PolarFoundation(cc.load_scene("sphere_on_plane"))):
        assert symbolic(model) is model


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


def test_a_load_that_a_model_does_not_give_is_refused(elements):
    with pytest.raises(ValueError, match="loads Fy_med, expected some of "):
        symbolic(elements).function("Fy_med")
