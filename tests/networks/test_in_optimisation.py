"""The CasADi functions where they are used: chosen loads, map, derivatives as nlpsol makes them, files."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import POSE_CENTRE, random_network, random_poses, random_surrogate


@pytest.fixture(scope="module", params=["patch", "two_stage"])
def surrogate(request):
    return random_surrogate(load_scene("knee"), request.param, seed=4)


def test_only_the_needed_networks_are_in_the_graph(surrogate):
    one, two, all_loads = (surrogate.function(names) for names in (["Fy_med"], ["Fy_med", "Fy_lat"], None))
    sizes = [_graph(function).n_instructions() for function in (one, two, all_loads)]
    assert sizes[0] < sizes[1] < 0.6 * sizes[2]
    pose = random_poses(1)[0]
    want = dict(zip(surrogate.load_names, surrogate([pose])[0], strict=True))
    np.testing.assert_allclose(two(pose).full().ravel(), [want["Fy_med"], want["Fy_lat"]], rtol=1e-12)
    np.testing.assert_allclose(surrogate([pose], ["Tz", "Fx"])[0], [want["Tz"], want["Fx"]], rtol=1e-12)
    assert surrogate.function(["Tz", "Fx"])(pose).shape == (2, 1)


def _graph(function):
    """What the function calls, which holds its networks."""
    steps = [function.instruction_MX(k) for k in range(function.n_instructions())]
    (graph,) = [step.which_function() for step in steps if step.is_call()]
    return graph


@pytest.mark.parametrize("parallel", [("serial",), ("thread", 2)])
def test_map_over_frames_keeps_value_and_derivatives(surrogate, parallel):
    function, count = surrogate.function(), 11
    weights = ca.MX.sym("weights", 7, count)
    mapped = function.map(count, *parallel)
    flat = ca.MX.sym("flat", 6 * count)
    lagrangian = ca.dot(weights, mapped(ca.reshape(flat, 6, count)))
    hessian = ca.Function("h", [flat, weights], [ca.hessian(lagrangian, flat)[0]])
    jacobian = ca.Function("j", [flat], [ca.jacobian(ca.vec(mapped(ca.reshape(flat, 6, count))), flat)])
    assert jacobian.nnz_out(0) == 42 * count, "frames are independent of each other"
    assert hessian.nnz_out(0) == 36 * count
    poses, w = random_poses(count, seed=2), np.random.default_rng(1).normal(size=(7, count))
    values, jacobians = surrogate.jacobian(poses)
    np.testing.assert_allclose(mapped(poses.T).full().T, values, rtol=1e-11, atol=1e-11 * np.abs(values).max())
    got = jacobian(poses.ravel()).full()
    pose, weight = ca.MX.sym("pose", 6), ca.MX.sym("weight", 7)
    single = ca.Function("s", [pose, weight], [ca.hessian(ca.dot(weight, function(pose)), pose)[0]])
    second = hessian(poses.ravel(), w).full()
    for frame in range(count):
        columns = slice(6 * frame, 6 * frame + 6)
        block = got[7 * frame : 7 * frame + 7, columns]
        np.testing.assert_allclose(block, jacobians[frame], rtol=1e-9, atol=1e-9 * np.abs(jacobians).max())
        want = single(poses[frame], w[:, frame]).full()
        np.testing.assert_allclose(second[columns, columns], want, rtol=1e-10, atol=1e-10 * np.abs(second).max())


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])
@pytest.mark.parametrize("kind", ["function", "load_and_root_function"])
def test_functions_made_by_factory_give_the_derivatives(surrogate, kind, compiled):
    function = getattr(surrogate, kind)(compiled=compiled)
    names = {"g": function.name_out()}
    seed, random = np.arange(1.0, 7.0), np.random.default_rng(1)
    weights = [random.normal(size=function.numel_out(i)) for i in range(function.n_out())]
    lam = [f"lam:{name}" for name in names["g"]]
    jacobian = function.factory("J", ["pose"], [f"jac:{name}:pose" for name in names["g"]])
    forward = function.factory("F", ["pose", "fwd:pose"], [f"fwd:{name}" for name in names["g"]])
    adjoint = function.factory("A", ["pose", *(f"adj:{name}" for name in names["g"])], ["adj:pose"])
    gradient = function.factory("G", ["pose", *lam], ["grad:g:pose"], names)
    hessian = function.factory("H", ["pose", *lam], ["hess:g:pose:pose"], names)
    x = ca.MX.sym("pose", 6)
    weighted = sum(ca.dot(w, output) for w, output in zip(weights, function.call([x]), strict=True))
    want_hessian = ca.Function("want", [x], [ca.hessian(weighted, x)[0]])
    for pose in random_poses(4, seed=2):
        slopes = [surrogate.jacobian([pose])[1][0], surrogate.root_loads([pose])[1][0]][: function.n_out()]
        total = sum(w @ slope for w, slope in zip(weights, slopes, strict=True))
        for got, moved, slope in zip(jacobian.call([pose]), forward.call([pose, seed]), slopes, strict=True):
            close(got.full(), slope, 6)
            close(moved.full().ravel(), slope @ seed, 6)
        close(adjoint(pose, *weights).full().ravel(), total, 6)
        close(gradient(pose, *weights).full().ravel(), total, 6)
        upper = hessian(pose, *weights).full()
        close(np.triu(upper) + np.triu(upper, 1).T, want_hessian(pose).full(), 6)


def test_saved_function_keeps_its_derivatives(surrogate, tmp_path):
    function, path = surrogate.function(), tmp_path / "knee.casadi"
    function.save(str(path))
    again = ca.Function.load(str(path))
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", 7)
    first, second = (
        ca.Function("all", [pose, weights], [f(pose), *ca.hessian(ca.dot(weights, f(pose)), pose)])
        for f in (function, again)
    )
    assert first.n_instructions() == second.n_instructions(), "the explicit derivatives must travel with the file"
    for a, b in zip(first(POSE_CENTRE, range(7)), second(POSE_CENTRE, range(7)), strict=True):
        np.testing.assert_array_equal(a.full(), b.full())


def test_liftoff_is_once_continuously_differentiable():
    """s = c·(ty - 27): N = N0·max(s, 0)²; at s = 0 everything is zero and finite, N'' jumps from 0 to 2·N0·c²."""
    scene = load_scene("sphere_on_plane")
    shift, scale = POSE_CENTRE, np.ones(6)
    base = random_network(np.random.default_rng(0), shift, scale, (2,), "algebraic", 1.0)
    first = np.zeros((2, 6))
    first[0, 1] = -0.5
    root = type(base)(shift, scale, (first, np.array([[1.0, 0.0]])), (np.zeros(2), np.zeros(1)))
    surrogate = PatchSurrogate(scene, {"root_contact": root})
    assert surrogate.load_names == ("Fy",)
    function, pose = surrogate.function(), ca.MX.sym("pose", 6)
    everything = ca.Function(
        "all", [pose], [function(pose), ca.jacobian(function(pose), pose), *ca.hessian(function(pose), pose)]
    )
    for offset, second in ((-1e-9, -2.0 * scene.reference_load * 0.25), (1e-9, 0.0), (0.0, None)):
        value, jacobian, hessian, _ = (part.full() for part in everything(shift + offset * np.eye(6)[1]))
        assert np.isfinite(hessian).all()
        assert abs(value).max() < 1e-12
        assert abs(jacobian).max() < 1e-5
        if second is not None:
            np.testing.assert_allclose(hessian[1, 1], second, rtol=1e-9)
    far = everything(shift + 50.0 * np.eye(6)[1])
    assert all(not part.full().any() for part in far), "exactly zero in every order out of contact"
