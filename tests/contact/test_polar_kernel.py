"""The kernel of polar quadrature in C: against NumPy, derivatives against differences, inside CasADi and IPOPT."""

from contextlib import nullcontext

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.compiler import CACHE_VARIABLE
from tests.support.compiler import flags_of_the_library, needs_compiler
from tests.support.derivative_checks import (
    check_hessians,
    check_jacobian,
    check_same_formulas,
    check_second_derivatives,
)
from tests.support.ready_poses import KNEE

RAYS = Rays(16, 3)
GROOVE = [-49.7, 1.0, 0.3, 0.02, 0.05, 0.1]
LIFTED = [2.0, 27.4, 0.3, 0.01, 0.02, -0.9]  # off laterally
SCENES = {  # scene, overrides, poses in contact and out of it
    "knee": ("knee", {}, [KNEE, LIFTED, [4.0, 27.48, -0.5, -0.004, 0.05, -0.45]]),
    "knee, log law": ("knee", {"law": "log"}, [KNEE, LIFTED]),
    "groove": ("patellofemoral", {}, [GROOVE, [-51.5, 6.0, -0.2, 0.02, -0.05, -0.1]]),
    "sphere": ("sphere_on_plane", {}, [[0.5, 29.8, 0.2, 0.1, 0.2, 0.3], [11.0, 30.4, -13.5, 0.0, 0.1, 0.2]]),
}
pytestmark = needs_compiler


@pytest.fixture(scope="module", params=SCENES)
def pair(request):
    """Compiled and NumPy model of a scene, and poses; the knee's kernel as users have it."""
    name, overrides, poses = SCENES[request.param]
    scene = cc.load_scene(name, **overrides)
    compiled, plain = (cc.PolarFoundation(scene, RAYS, compiled=c) for c in (True, False))
    with flags_of_the_library() if request.param == "knee" else nullcontext():
        yield compiled, plain, np.array(poses)


def test_c_and_numpy_are_the_same_formulas(pair):
    check_same_formulas(*pair)


def test_jacobians_are_the_derivatives_of_the_values(pair):
    compiled, _, poses = pair
    check_jacobian(compiled, poses, 1e-4)


def test_the_casadi_function_gives_the_model_s_values_and_derivatives(pair):
    model, _, poses = pair
    both = model.load_and_root_function()
    x = ca.MX.sym("pose", 6)
    slopes = ca.Function("slopes", [x], [ca.jacobian(output, x) for output in both(x)])
    for pose, loads, jacobian, roots, root_slopes in zip(
        poses, *model.jacobian(poses), *model.root_loads(poses), strict=True
    ):
        rounding = 1e-14 * np.abs(jacobian).max()
        np.testing.assert_allclose(np.array(both(pose)[0])[:, 0], loads, rtol=1e-12, atol=rounding)
        np.testing.assert_allclose(np.array(both(pose)[1])[:, 0], roots, rtol=1e-12)
        np.testing.assert_allclose(np.array(slopes(pose)[0]), jacobian, rtol=1e-12, atol=rounding)
        np.testing.assert_allclose(np.array(slopes(pose)[1]), root_slopes, rtol=1e-9, atol=1e-9)


def test_hessians_are_the_derivatives_of_the_jacobians(pair):
    model, _, poses = pair
    check_hessians(model, poses)


def test_hessians_of_some_loads_are_those_of_all_with_the_others_weighted_by_nothing(pair):
    for model, poses in ((pair[0], pair[2]), (pair[1], pair[2][:1])):
        last, first = model.load_names[-1], model.load_names[0]
        all_weights = np.zeros(len(model.load_names))
        all_weights[[-1, 0]] = 2.0, -0.5
        np.testing.assert_array_equal(
            model.hessian(poses, [2.0, -0.5], [last, first]), model.hessian(poses, all_weights)
        )
        with pytest.raises(ValueError, match=r"weights has shape \(2,\), expected \(1,\)"):
            model.hessian(poses[0], [2.0, -0.5], first)


def test_jacobians_of_jacobians_hold_every_hessian(pair):
    model, _, poses = pair
    check_second_derivatives(model, poses)


def falling(function):
    """ty, vy of the knee's femur let go above the insert, damped, after 20 ms: (start, weight) -> state."""
    state, weight = ca.MX.sym("state", 2), ca.MX.sym("weight")
    loads = function(ca.vertcat(KNEE[0], state[0], KNEE[2:]))
    slopes = ca.vertcat(state[1], 200.0 * (-loads[0] - loads[1] - weight) - 50.0 * state[1])
    options = {"abstol": 1e-10, "reltol": 1e-10}
    return ca.integrator("falling", "cvodes", {"x": state, "p": weight, "ode": slopes}, 0.0, 0.02, options)


@pytest.mark.parametrize("model", ["foundation", "surrogate"])
def test_sensitivities_of_an_integrator_are_the_derivatives_of_where_it_ends(model):
    """Forward, which ask for the Jacobian of the Jacobian, and adjoint."""
    if model == "foundation":
        function = cc.PolarFoundation(cc.load_scene("knee"), RAYS).function()
    else:
        function = cc.load_surrogate("knee").function(compiled=True)
    integrator, weight, start, step = falling(function), ca.MX.sym("weight"), [27.3, 0.0], 0.1
    ends = [integrator(x0=start, p=500.0 + side)["xf"].full() for side in (-step, step)]
    end = integrator(x0=start, p=weight)["xf"]
    forward, adjoint = (
        ca.Function("sensitivity", [weight], [derivative])(500.0).full()
        for derivative in (ca.jtimes(end, weight, 1.0), ca.jtimes(end[0], weight, 1.0, True))
    )
    differences = (ends[1] - ends[0]) / (2.0 * step)
    np.testing.assert_allclose(forward, differences, rtol=1e-4)
    np.testing.assert_allclose(adjoint[0], differences[0], rtol=1e-4)


@pytest.fixture(scope="module")
def bending():
    """Poses of the knee pressed at flexions at which junctions of its arcs lie off, across and amid its spots."""
    model = cc.PolarFoundation(cc.load_scene("knee"), Rays(8, 3))
    start = [[0.5, 27.23, 0.1, 0.0, -0.05, angle] for angle in -np.deg2rad(np.linspace(-5.0, 85.0, 19))]
    poses, found = cc.settle(model, start, free=("ty", "rx"), targets={"Fy_med": -900.0, "Fy_lat": -500.0})
    assert found.converged.all()
    return poses


def test_eight_rays_are_enough_wherever_arcs_meet(bending):
    few, many = (cc.PolarFoundation(cc.load_scene("knee"), rays) for rays in (Rays(8, 3), Rays(96, 6)))
    scales = [900.0 if name.startswith("F") else 20e3 for name in few.load_names]
    np.testing.assert_allclose(few(bending) / scales, many(bending) / scales, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize(("rays", "tolerance"), [(8, 5e-6), (16, 5e-7)])
def test_second_derivatives_are_those_of_the_first_wherever_arcs_meet(bending, rays, tolerance):
    """Differences of fourth order; an angle counts 25 mm to the radian."""
    model = cc.PolarFoundation(cc.load_scene("knee"), Rays(rays, 3))
    x, scales = ca.MX.sym("pose", 6), np.repeat([1.0, 25.0], 3)
    total = ca.dot(ca.DM([1.0] * 4 + [0.04] * 3), model.function()(x))
    gradient, hessian = (ca.Function("f", [x], [f]) for f in (ca.gradient(total, x), ca.hessian(total, x)[0]))
    for pose in bending:
        moves = np.diag(3e-5 / scales)
        ends = [[np.array(gradient(pose + k * move))[:, 0] for k in (-2, -1, 1, 2)] for move in moves]
        columns = [(a - 8.0 * b + 8.0 * c - d) / (12.0 * 3e-5) / scales for a, b, c, d in ends]
        exact = np.array(hessian(pose)) / np.outer(scales, scales)
        np.testing.assert_allclose(exact, np.column_stack(columns), rtol=0.0, atol=tolerance * np.abs(exact).max())


def test_some_loads_a_batch_and_a_pose_that_is_not_a_number():
    model = cc.PolarFoundation(cc.load_scene("knee"), RAYS)
    poses = np.array([KNEE, LIFTED, KNEE])
    f = model.function(["Fx", "Fy_lat"], batch=3)
    rows = [model.load_names.index(name) for name in ("Fx", "Fy_lat")]
    np.testing.assert_allclose(np.array(f(poses.T)).T, model(poses)[:, rows], rtol=1e-12, atol=1e-12)
    assert np.isnan(np.array(model.function()([*KNEE[:5], np.nan]))).any()
    with pytest.raises(ValueError, match="expected some of"):
        model.function(["Fq"])


def test_ipopt_settles_the_knee_on_it():
    """Wanted medial and lateral forces are constraints on named loads; ty and rx are free."""
    model = cc.foundation("knee")
    f = model.function()
    x = ca.MX.sym("x", 2)
    pose = ca.vertcat(KNEE[0], x[0], KNEE[2], x[1], KNEE[4], KNEE[5])
    loads = f(pose)
    problem = {"x": x, "f": ca.sumsqr(x - ca.DM([27.0, 0.0])), "g": loads[:2] + ca.DM([700.0, 500.0])}
    solver = ca.nlpsol("settled", "ipopt", problem, {"ipopt.print_level": 0, "print_time": False})
    found = solver(x0=[26.8, 0.0], lbg=0.0, ubg=0.0)
    assert solver.stats()["success"]
    assert solver.stats()["iter_count"] < 30
    in_numpy = cc.PolarFoundation(model.scene, model.rays, compiled=False)
    by_newton, report = cc.settle(in_numpy, [KNEE], ("ty", "rx"), {"Fy_med": -700.0, "Fy_lat": -500.0})
    assert report.converged.all()
    np.testing.assert_allclose(np.array(found["x"])[:, 0], by_newton[0, [1, 3]], atol=1e-6)


def test_without_a_compiler_it_warns_and_runs_in_numpy(monkeypatch, tmp_path):
    with_compiler = cc.PolarFoundation(cc.load_scene("knee"), RAYS).load_and_root_function()
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    model = cc.PolarFoundation(cc.load_scene("knee"), RAYS)
    with pytest.warns(RuntimeWarning, match="no-such-compiler"):
        f = model.load_and_root_function()
    for slow, fast in zip(f(KNEE), with_compiler(KNEE), strict=True):
        np.testing.assert_allclose(np.array(slow), np.array(fast), rtol=1e-9, atol=1e-7)
    x = ca.MX.sym("pose", 6)
    jacobians, hessians = [], []
    for function in (with_compiler, f):
        loads = function(x)[0]
        jacobians.append(np.array(ca.Function("J", [x], [ca.jacobian(loads, x)])(KNEE)))
        hessians.append(np.array(ca.Function("H", [x], [ca.hessian(loads[0], x)[0]])(KNEE)))
    np.testing.assert_allclose(jacobians[1], jacobians[0], rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(hessians[1], hessians[0], atol=1e-3 * np.abs(hessians[0]).max())
    assert all(np.isnan(np.array(output)).all() for output in f([np.nan] * 6))
