"""The CasADi functions where they are used: chosen loads, map, derivatives as nlpsol makes them, files."""

import copy
import pickle

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.networks.functions import hessian_function
from casadi_contact.scenes.loading import load_scene
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import POSE_CENTRE, random_poses, random_surrogate
from tests.support.ready_poses import KNEE


@pytest.fixture(scope="module", params=["patch", "two_stage"])
def surrogate(request):
    return random_surrogate(load_scene("knee"), request.param, seed=4)


def test_map_over_frames_keeps_value_and_derivatives(surrogate):
    function, count = surrogate.function(), 11
    weights = ca.MX.sym("weights", 7, count)
    mapped = function.map(count, "thread", 2)
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
    single = hessian_function(function)
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
    function, path = surrogate.function(compiled=False), tmp_path / "knee.casadi"
    function.save(str(path))
    again = ca.Function.load(str(path))
    first, second = ([f(POSE_CENTRE), hessian_function(f)(POSE_CENTRE, range(7))] for f in (function, again))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.full(), b.full())


@pytest.mark.parametrize("made", [lambda m: m.function(), lambda m: m.root_function(compiled=False),
                                  lambda m: m.pressure_function(["contact_area_med"])])  # fmt: skip
@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])
def test_functions_of_contact_models_can_be_copied_and_sent_to_other_processes(made, compiled):
    """Those that call Python back as well."""
    function = made(cc.PolarFoundation(load_scene("knee"), compiled=compiled))
    for again in (copy.copy(function), copy.deepcopy(function), pickle.loads(pickle.dumps(function))):
        close(again(KNEE).full(), function(KNEE).full(), 14)


@needs_compiler
def test_code_that_casadi_compiles_itself_fails_in_python_where_it_calls_a_kernel(surrogate):
    pose = ca.MX.sym("pose", 6)
    f = ca.Function("f", [pose], [surrogate.function()(pose)], {"jit": True, "compiler": "shell"})
    with pytest.raises(RuntimeError, match="Evaluation failed"):
        f(POSE_CENTRE)
