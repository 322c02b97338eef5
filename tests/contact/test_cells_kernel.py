"""The kernel of cubic cells in C: against NumPy, derivatives against differences, inside CasADi and IPOPT."""

import subprocess
import sys
from contextlib import nullcontext

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from tests.support.compiler import flags_of_the_library, needs_compiler
from tests.support.derivative_checks import (
    check_hessians,
    check_jacobian,
    check_same_formulas,
    check_second_derivatives,
)
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh

SIZE = Cells(1.1, 0.9)
RADIUS_MM = 30.0
IN_CONTACT = [0.3, RADIUS_MM - 0.35, 0.2, 0.02, 0.1, -0.02]
LIFTED = [0.3, RADIUS_MM + 0.4, 0.2, 0.02, 0.1, -0.02]
AT_RIM = [9.0, RADIUS_MM - 0.4, 0.2, 0.02, 0.1, -0.02]
BARELY = [0.3, RADIUS_MM + 0.282, 0.2, 0.02, 0.1, -0.02]
CUP_POSES = [[1.0, -0.5, -23.8, 0.1, 0.2, 0.3], [1.0, -0.5, -24.5, 0.1, 0.2, 0.3]]
pytestmark = needs_compiler


@pytest.fixture(scope="module", params=["mesh", "mesh, log law", "cup"])
def pair(request, tmp_path_factory):
    """Compiled and NumPy model of a scene, and poses: in contact, at the rim, at the brink of it and out of it.

    The mesh's kernel is as users have it.
    """
    if request.param.startswith("mesh"):
        plate = sheet_mesh(20.0, 0.8, lambda x, z: 0.3 * np.exp(-((x - 2.0) ** 2 + z**2) / 20.0))
        scene = scene_of(tmp_path_factory.mktemp("ball"), cap_mesh(RADIUS_MM, 1.5, 0.5), plate)
        if request.param.endswith("law"):
            scene = scene.with_overrides(law="log")
        poses = [IN_CONTACT, AT_RIM, BARELY, LIFTED]
    else:
        scene, poses = cc.load_scene("glenohumeral"), CUP_POSES
    compiled, plain = (cc.CellFoundation(scene, SIZE, compiled=c) for c in (True, False))
    with flags_of_the_library() if request.param == "mesh" else nullcontext():
        yield compiled, plain, np.array(poses)


def test_c_and_numpy_are_the_same_formulas(pair):
    """So culling in C, which NumPy does more simply, loses nothing."""
    check_same_formulas(*pair)


def test_jacobians_are_the_derivatives_of_the_values(pair):
    compiled, _, poses = pair
    check_jacobian(compiled, poses, 1e-6)


def test_hessians_are_the_derivatives_of_the_jacobians(pair):
    compiled, _, poses = pair
    check_hessians(compiled, poses)


def test_jacobians_of_jacobians_hold_every_hessian(pair):
    compiled, _, poses = pair
    check_second_derivatives(compiled, poses)


def test_loads_are_the_same_to_the_last_bit_whatever_was_asked_before_in_a_pose(pair):
    """The kernel keeps what it found in a pose, for the Jacobian and the Hessian there."""
    compiled, _, poses = pair
    weights = np.ones(len(compiled.load_names))
    for pose, other in zip(poses, np.roll(poses, 1, axis=0), strict=True):
        compiled.hessian(other, weights)
        after_value = compiled(pose), *compiled.jacobian(pose), compiled.hessian(pose, weights)
        compiled.hessian(other, weights)
        hessian = compiled.hessian(pose, weights)
        before_value = *compiled.jacobian(pose), compiled(pose)
        for first, second in zip(after_value, (before_value[2], *before_value[:2], hessian), strict=True):
            np.testing.assert_array_equal(first, second)


def test_a_batch_gives_each_pose_s_loads_and_a_pose_that_is_not_a_number_gives_none():
    model = cc.CellFoundation(cc.load_scene("glenohumeral"), SIZE)
    poses = np.array([*CUP_POSES, [*CUP_POSES[0][:5], np.nan]])
    loads = np.array(model.function(batch=3)(poses.T)).T
    np.testing.assert_allclose(loads[:2], model(poses[:2]), rtol=1e-12, atol=1e-12)
    assert np.isnan(loads[2]).all()


def test_a_half_space_s_kernel_is_numpy_s_and_its_hessian_the_derivative_of_its_jacobian():
    compiled, plain = (cc.CellFoundation(cc.load_scene("punch_on_plane"), SIZE, compiled=c) for c in (True, False))
    poses = np.array([[0.3, -0.2, 0.1, 0.01, 0.3, -0.02]])
    check_same_formulas(compiled, plain, poses)
    check_hessians(compiled, poses)


def test_many_poses_over_the_reach_lose_no_contact_to_culling(pair):
    compiled, plain, poses = pair
    random = np.random.default_rng(0)
    spread = np.array([3.0, 0.3, 3.0, 0.1, 0.3, 0.1]) * random.uniform(-1.0, 1.0, (60, 6))
    many = poses[0] + spread
    scale = np.abs(plain(many)).max()
    np.testing.assert_allclose(compiled(many), plain(many), atol=1e-9 * scale)


def test_deep_contact_at_the_edge_of_the_body_is_not_lost_to_culling(pair):
    """Where the grid of its distances ends, too; an open mesh has its edge, and jumps of the distance, there."""
    compiled, plain, poses = pair
    deep = np.repeat(poses[:1], 30, axis=0)
    if compiled.scene.shape == "mesh":
        deep[:, 5] = np.linspace(-0.6, 0.6, 30)
        deep[:, 1] -= np.geomspace(0.2, 4.0, 30)[np.random.default_rng(0).permutation(30)]
    else:
        deep[:, 2] += np.linspace(0.0, 3.0, 30)
    scale = np.abs(plain(deep)).max(axis=1, keepdims=True)
    assert scale.max() > 5000.0
    np.testing.assert_allclose((compiled(deep) - plain(deep)) / scale, 0.0, atol=1e-9)


def test_a_saved_function_evaluates_alike_in_another_process(tmp_path):
    """All that it needs, tables included, lies in its library."""
    model = cc.CellFoundation(cc.load_scene("glenohumeral"), SIZE)
    model.function().save(str(tmp_path / "loads.casadi"))
    code = (
        "import casadi as ca, sys; f = ca.Function.load(sys.argv[1]); "
        f"print(*[float(x).hex() for x in f({CUP_POSES[0]}).full().ravel()])"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "loads.casadi")]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert [float.fromhex(word) for word in out.split()] == model(CUP_POSES[:1])[0].tolist()


def test_ipopt_settles_a_shoulder_on_it():
    """The wanted force is a constraint on a named load; tz is free, and the exact Hessian is used."""
    model = cc.CellFoundation(cc.load_scene("glenohumeral"), SIZE)
    x = ca.MX.sym("x", 1)
    loads = model.function()(ca.vertcat(1.0, -0.5, x, 0.1, 0.2, 0.3))[model.load_names.index("Fz")]
    problem = {"x": x, "f": (x + 24.0) ** 2, "g": loads - 400.0}
    solver = ca.nlpsol("settled", "ipopt", problem, {"ipopt.print_level": 0, "print_time": False})
    found = solver(x0=-23.9, lbg=0.0, ubg=0.0)
    assert solver.stats()["success"]
    assert solver.stats()["iter_count"] < 30
    pose = [[1.0, -0.5, float(found["x"]), 0.1, 0.2, 0.3]]
    assert model(pose)[0][model.load_names.index("Fz")] == pytest.approx(400.0, abs=1e-4)
