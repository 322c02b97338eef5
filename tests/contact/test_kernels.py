"""Kernels of foundations in C: against NumPy, derivatives against differences, inside CasADi and IPOPT."""

import subprocess
import sys
from contextlib import nullcontext

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.compiler import CACHE_VARIABLE
from tests.support.agreement import check_hessians, check_jacobian, check_same_formulas, check_second_derivatives
from tests.support.compiler import flags_of_the_library, needs_compiler
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh
from tests.support.ready_poses import KNEE, PLACES, placed

RAYS, SIZE, RADIUS_MM = Rays(16, 3), Cells(1.1, 0.9), 30.0
LIFTED = [2.0, 27.4, 0.3, 0.01, 0.02, -0.9]  # off laterally
BALL = [0.3, RADIUS_MM - 0.35, 0.2, 0.02, 0.1, -0.02]
ON_MESH = [
    BALL,
    [9.0, RADIUS_MM - 0.4, *BALL[2:]],
    [0.3, RADIUS_MM + 0.272, *BALL[2:]],  # loads fade out
    [0.3, RADIUS_MM + 0.282, *BALL[2:]],
    [0.3, RADIUS_MM + 0.4, *BALL[2:]],
]
ON_PLANE = [[0.5, 29.8, 0.2, 0.1, 0.2, 0.3], [11.5, 29.7, -0.4, 0.1, 0.2, 0.3], [0.5, 30.2, 0.2, 0.1, 0.2, 0.3]]
KINDS = {  # scene, overrides, class and resolution, poses in contact, at the rim and out of it, Jacobian's tolerance
    "knee": ("knee", {}, cc.PolarFoundation, RAYS, [KNEE, LIFTED, [4.0, 27.48, -0.5, -0.004, 0.05, -0.45]]),
    "groove": ("patellofemoral", {}, cc.PolarFoundation, RAYS, [[-49.7, 1.0, 0.3, 0.02, 0.05, 0.1]]),
    "sphere, log law": ("sphere_on_plane", {"law": "log"}, cc.PolarFoundation, RAYS, ON_PLANE[:1]),
    "hip": ("hip", {}, cc.CupFoundation, 32, None),
    "shoulder, log law": ("glenohumeral", {"law": "log"}, cc.CupFoundation, 32, None),
    "mesh in cells": (None, {}, cc.CellFoundation, SIZE, ON_MESH),
    "sphere in cells, log law": ("sphere_on_plane", {"law": "log"}, cc.CellFoundation, SIZE, ON_PLANE),
    "punch in cells": ("punch_on_plane", {}, cc.CellFoundation, SIZE, [[0.3, -0.2, 0.1, 0.01, 0.3, -0.02]]),
}
pytestmark = needs_compiler


@pytest.fixture(scope="module", params=KINDS)
def pair(request, tmp_path_factory):
    """Compiled and NumPy model of a scene, and poses; one of each kind as users have it."""
    name, overrides, kind, size, poses = KINDS[request.param]
    if name is None:
        plate = sheet_mesh(20.0, 0.8, lambda x, z: 0.3 * np.exp(-((x - 2.0) ** 2 + z**2) / 20.0))
        scene = scene_of(tmp_path_factory.mktemp("ball"), cap_mesh(RADIUS_MM, 1.5, 0.5), plate)
    else:
        scene = cc.load_scene(name, **overrides)
    compiled, plain = (kind(scene, size, compiled=c) for c in (True, False))
    poses = placed(scene, PLACES[scene.name]) if poses is None else np.array(poses)
    with flags_of_the_library() if request.param in ("knee", "hip", "mesh in cells") else nullcontext():
        assert compiled._library is not None, "else NumPy is compared with itself"
        yield compiled, plain, poses


def test_c_and_numpy_are_the_same_formulas(pair):
    check_same_formulas(*pair)


def test_derivatives_are_those_of_the_values(pair):
    compiled, _, poses = pair
    check_jacobian(compiled, poses, 1e-4)
    check_hessians(compiled, poses)
    check_second_derivatives(compiled, poses[:2])


def test_the_casadi_function_gives_the_model_s_values_and_derivatives(pair):
    model, _, poses = pair
    both, x = model.load_and_root_function(), ca.MX.sym("pose", 6)
    jacobians = ca.Function("jacobians", [x], [ca.jacobian(output, x) for output in both(x)])
    for pose, loads, jacobian, roots, by_pose in zip(
        poses, *model.jacobian(poses), *model.root_loads(poses), strict=True
    ):
        rounding = 1e-14 * np.abs(jacobian).max()
        np.testing.assert_allclose(np.array(both(pose)[0])[:, 0], loads, rtol=1e-12, atol=rounding)
        np.testing.assert_allclose(np.array(both(pose)[1])[:, 0], roots, rtol=1e-12)
        np.testing.assert_allclose(np.array(jacobians(pose)[0]), jacobian, rtol=1e-12, atol=rounding)
        np.testing.assert_allclose(np.array(jacobians(pose)[1]), by_pose, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("pair", ["sphere, log law", "sphere in cells, log law"], indirect=True)
def test_a_batch_gives_each_pose_s_loads_and_a_pose_that_is_not_a_number_gives_none(pair):
    model, _, poses = pair
    three = np.array([poses[0], poses[-1], [*poses[0][:5], np.nan]])
    loads = np.array(model.function(model.load_names[:2], batch=3)(three.T)).T
    np.testing.assert_allclose(loads[:2], model(three[:2])[:, :2], rtol=1e-12, atol=1e-12)
    assert np.isnan(loads[2]).all()


@pytest.mark.parametrize("pair", ["mesh in cells", "sphere in cells, log law"], indirect=True)
def test_no_contact_is_lost_to_culling(pair):
    """Over the reach, and deep at the edge of the body, where the grid of its distances ends and an open mesh jumps."""
    compiled, plain, poses = pair
    random = np.random.default_rng(0)
    many = poses[0] + np.array([3.0, 0.3, 3.0, 0.1, 0.3, 0.1]) * random.uniform(-1.0, 1.0, (30, 6))
    deep = np.repeat(poses[:1], 16, axis=0)
    deep[:, 5] = np.linspace(-0.6, 0.6, 16)
    deep[:, 1] -= random.permutation(np.geomspace(0.2, 4.0, 16))
    assert np.abs(plain(deep)).max() > 5000.0
    for at in (many, deep):
        np.testing.assert_allclose(compiled(at), plain(at), atol=1e-9 * np.abs(plain(at)).max())


def test_second_derivatives_are_those_of_the_first_wherever_arcs_meet():
    """At flexions at which junctions of its arcs lie off, across and amid a knee's contact; by differences of fourth
    order; an angle counts 25 mm to the radian."""
    model = cc.PolarFoundation(cc.load_scene("knee"), RAYS)
    start = [[0.5, 27.23, 0.1, 0.0, -0.05, angle] for angle in -np.deg2rad(np.linspace(-5.0, 85.0, 19))]
    poses, found = cc.settle(model, start, free=("ty", "rx"), targets={"Fy_med": -900.0, "Fy_lat": -500.0})
    assert found.converged.all()
    x, scales = ca.MX.sym("pose", 6), np.repeat([1.0, 25.0], 3)
    total = ca.dot(ca.DM([1.0] * 4 + [0.04] * 3), model.function()(x))
    gradient, hessian = (ca.Function("f", [x], [f]) for f in (ca.gradient(total, x), ca.hessian(total, x)[0]))
    for pose in poses:
        moves = np.diag(3e-5 / scales)
        ends = [[np.array(gradient(pose + k * move))[:, 0] for k in (-2, -1, 1, 2)] for move in moves]
        columns = [(a - 8.0 * b + 8.0 * c - d) / (12.0 * 3e-5) / scales for a, b, c, d in ends]
        exact = np.array(hessian(pose)) / np.outer(scales, scales)
        np.testing.assert_allclose(exact, np.column_stack(columns), rtol=0.0, atol=5e-7 * np.abs(exact).max())


def test_a_saved_function_evaluates_alike_in_another_process(tmp_path):
    """All that it needs, tables included, lies in its library."""
    model = cc.CellFoundation(cc.load_scene("sphere_on_plane", law="log"), SIZE)
    model.function().save(str(tmp_path / "loads.casadi"))
    code = (
        "import casadi as ca, sys; f = ca.Function.load(sys.argv[1]); "
        f"print(*[float(x).hex() for x in f({ON_PLANE[0]}).full().ravel()])"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "loads.casadi")]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert [float.fromhex(word) for word in out.split()] == model(ON_PLANE[:1])[0].tolist()


def test_without_a_compiler_it_warns_and_runs_in_numpy(monkeypatch, tmp_path):
    with_compiler = cc.PolarFoundation(cc.load_scene("knee"), RAYS).load_and_root_function()
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    with pytest.warns(RuntimeWarning, match="no-such-compiler"):
        f = cc.PolarFoundation(cc.load_scene("knee"), RAYS).load_and_root_function()
    x = ca.MX.sym("pose", 6)
    found = []
    for function in (with_compiler, f):
        loads, roots = function(x)
        outputs = [loads, roots, ca.jacobian(loads, x), ca.hessian(loads[0], x)[0]]
        found.append([np.array(part) for part in ca.Function("all", [x], outputs)(KNEE)])
    for fast, slow, tolerance in zip(*found, (1e-9, 1e-9, 1e-6, 1e-3), strict=True):
        np.testing.assert_allclose(slow, fast, atol=tolerance * np.abs(fast).max())
    assert all(np.isnan(np.array(output)).all() for output in f([np.nan] * 6))
