"""torch = NumPy = CasADi, in values, first and second derivatives, in and out of contact."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.networks.activations import ACTIVATIONS
from casadi_contact.scenes.loading import load_scene
from tests.support.agreement import agree
from tests.support.random_surrogates import IN_PARTS, random_poses, random_surrogate, scene_called
from tests.support.second_derivatives import evaluated

torch_oracle = pytest.importorskip("tests.support.torch_oracle", reason="torch is not installed", exc_type=ImportError)

CASES = [(scene, structure) for scene in ("knee", "sphere_on_plane") for structure in ("patch", "two_stage")]
CASES += [("hip", "patch"), ("patellofemoral", "patch"), (IN_PARTS, "patch")]  # N as a magnitude, N = +Fx


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(("scene", "structure"), CASES)
@pytest.mark.parametrize("what", ["loads", "roots"])
def test_all_evaluations_agree(scene, structure, activation, what):
    surrogate = random_surrogate(scene_called(scene), structure, activation, seed=3)
    poses = random_poses(12, seed=1)
    function = surrogate.function() if what == "loads" else surrogate.root_function()
    in_numpy = surrogate.jacobian(poses) if what == "loads" else surrogate.root_loads(poses)
    if what == "loads":
        np.testing.assert_array_equal(surrogate(poses), in_numpy[0])
    signs = np.sign(surrogate.root_loads(poses)[0])
    assert {-1.0, 1.0} <= set(signs.ravel()), "the poses must lie on both sides of liftoff"
    weights = np.random.default_rng(5).normal(size=in_numpy[0].shape)
    wanted = torch_oracle.oracles(surrogate, poses, weights, loads=what == "loads")
    for order, (graph, want) in enumerate(zip(evaluated(function, poses, weights), wanted, strict=True)):
        agree(graph, want, order)
        if order < 2:
            agree(in_numpy[order], want, order)
            np.testing.assert_array_equal(in_numpy[order] == 0.0, want == 0.0, "out of contact all is exactly zero")


@pytest.mark.parametrize(("scene", "structure"), CASES)
def test_combined_and_numeric_functions_agree_with_the_single_ones(scene, structure):
    surrogate = random_surrogate(scene_called(scene), structure, seed=8)
    loads, roots, both = surrogate.function(), surrogate.root_function(), surrogate.load_and_root_function()
    numeric, pose, poses = surrogate.jacobian_function(), ca.MX.sym("pose", 6), random_poses(8)
    singles = ca.Function("a", [pose], [ca.vertcat(loads(pose), roots(pose))])
    together = ca.Function("b", [pose], [ca.vertcat(*both(pose))])
    weights = np.random.default_rng(2).normal(size=(len(poses), singles.numel_out(0)))
    wanted = evaluated(singles, poses, weights)
    for order, (got, want) in enumerate(zip(evaluated(together, poses, weights), wanted, strict=True)):
        agree(got, want, order)
    found = [[output.full() for output in numeric(x)] for x in poses]
    agree([value.ravel() for value, _ in found], wanted[0][:, : loads.numel_out(0)])
    agree([jacobian for _, jacobian in found], wanted[1][:, : loads.numel_out(0)], 1)


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
