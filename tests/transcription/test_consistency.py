"""torch = NumPy = CasADi, in values, first and second derivatives, in and out of contact."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.activations import ACTIVATIONS
from casadi_contact.scenes.scene import load_scene
from tests.support.random_surrogates import IN_PARTS, random_poses, random_surrogate, scene_called

torch_oracle = pytest.importorskip("tests.support.torch_oracle", reason="torch is not installed", exc_type=ImportError)

CASES = [(scene, structure) for scene in ("knee", "sphere_on_plane") for structure in ("patch", "two_stage")]
CASES += [("hip", "patch"), ("patellofemoral", "patch"), (IN_PARTS, "patch")]  # N as a magnitude, N = +Fx


def close(got, want, digits, least=1e-300):
    """Equal to a fraction 10^-digits of the largest entry, or of `least` where that is larger."""
    got, want = np.asarray(got), np.asarray(want)
    np.testing.assert_allclose(got, want, rtol=10.0**-digits, atol=10.0**-digits * max(least, np.abs(want).max()))


def second_derivatives(function: ca.Function) -> ca.Function:
    """pose, λ -> Hessian of λᵀ·output, the way nlpsol builds it."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    lagrangian = ca.dot(weights, function(pose))
    return ca.Function("lagrangian_hessian", [pose, weights], [ca.hessian(lagrangian, pose)[0]])


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(("scene", "structure"), CASES)
@pytest.mark.parametrize("what", ["loads", "roots"])
def test_all_evaluations_agree(scene, structure, activation, what):
    surrogate = random_surrogate(scene_called(scene), structure, activation, seed=3)
    poses = random_poses(12, seed=1)
    function = surrogate.function() if what == "loads" else surrogate.root_function()
    hessian, jacobian = second_derivatives(function), function.jacobian()
    values, jacobians = surrogate.jacobian(poses) if what == "loads" else surrogate.root_loads(poses)
    if what == "loads":
        np.testing.assert_array_equal(surrogate(poses), values)
    signs = np.sign(surrogate.root_loads(poses)[0])
    assert {-1.0, 1.0} <= set(signs.ravel()), "the poses must lie on both sides of liftoff"
    rng = np.random.default_rng(5)
    for pose, value, jac in zip(poses, values, jacobians, strict=True):
        want, want_jacobian, want_hessian = torch_oracle.oracle(surrogate, pose, loads=what == "loads")
        close(value, want, 12)
        close(function(pose).full().ravel(), want, 12)
        close(jac, want_jacobian, 9)
        close(jacobian(pose, 0).full(), want_jacobian, 9)
        weights = rng.normal(size=len(want))
        got = hessian(pose, weights).full()
        np.testing.assert_array_equal(got, got.T)
        close(got, np.einsum("l,lij->ij", weights, want_hessian), 9)


@pytest.mark.parametrize(("scene", "structure"), CASES)
def test_combined_and_numeric_functions_agree_with_the_single_ones(scene, structure):
    surrogate = random_surrogate(scene_called(scene), structure, seed=8)
    loads, roots, both = surrogate.function(), surrogate.root_function(), surrogate.load_and_root_function()
    numeric, pose = surrogate.jacobian_function(), ca.MX.sym("pose", 6)
    weights = ca.MX.sym("w", loads.numel_out(0) + roots.numel_out(0))
    single = ca.Function(
        "a", [pose, weights], list(ca.hessian(ca.dot(weights, ca.vertcat(loads(pose), roots(pose))), pose))
    )
    double = ca.Function("b", [pose, weights], list(ca.hessian(ca.dot(weights, ca.vertcat(*both(pose))), pose)))
    rng = np.random.default_rng(2)
    for x in random_poses(8):
        close(both(x)[0], loads(x), 14)
        close(both(x)[1], roots(x), 14)
        close(numeric(x)[0], loads(x), 14)
        close(numeric(x)[1], loads.jacobian()(x, 0), 14)
        w = rng.normal(size=weights.numel())
        for got, want in zip(double(x, w), single(x, w), strict=True):
            close(got, want, 13)


def test_third_derivatives_exist():
    """A user may differentiate once more; CasADi does that automatically on the Hessian's graph."""
    surrogate = random_surrogate(load_scene("knee"), "patch")
    pose = ca.MX.sym("pose", 6)
    second = ca.hessian(ca.sum1(surrogate.function()(pose)), pose)[0]
    entry = ca.Function("entry", [pose], [second[3, 1], ca.jacobian(second[3, 1], pose)])
    x = random_poses(40)[int(np.argmax(surrogate.root_loads(random_poses(40))[0].min(axis=1)))]
    step = 1e-6
    by_difference = [float(entry(x + step * e)[0] - entry(x - step * e)[0]) / (2 * step) for e in np.eye(6)]
    np.testing.assert_allclose(
        entry(x)[1].full().ravel(), by_difference, rtol=1e-5, atol=1e-5 * np.abs(by_difference).max()
    )
