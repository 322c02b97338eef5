"""Compiled kernels: torch = NumPy = kernel in values and both derivatives, everywhere a pose may go."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.activations import ACTIVATIONS
from casadi_contact.scenes.scene import load_scene
from casadi_contact.structures import load_surrogate
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import (
    IN_PARTS,
    POSE_CENTRE,
    POSE_SPREAD,
    random_poses,
    random_surrogate,
    scene_called,
)
from tests.transcription.test_consistency import close, second_derivatives

torch_oracle = pytest.importorskip("tests.support.torch_oracle", reason="torch is not installed", exc_type=ImportError)
pytestmark = needs_compiler

CASES = [(scene, structure) for scene in ("knee", "sphere_on_plane") for structure in ("patch", "two_stage")]
CASES += [("hip", "patch"), ("patellofemoral", "patch"), (IN_PARTS, "patch")]  # N as a magnitude, N = +Fx


def far_poses(count: int) -> np.ndarray:
    """Poses from inside to a hundred times outside the random surrogates' range."""
    reach = np.geomspace(0.5, 100.0, count)[:, None]
    return POSE_CENTRE + reach * POSE_SPREAD * np.random.default_rng(4).uniform(-1.0, 1.0, (count, 6))


def at_liftoff(surrogate, poses: np.ndarray) -> np.ndarray:
    """Poses moved along ty to where the first patch just touches, and a hair to both sides."""
    low, high = poses.copy(), poses.copy()
    low[:, 1], high[:, 1] = POSE_CENTRE[1] - 3.0, POSE_CENTRE[1] + 3.0
    sign = np.sign(surrogate.root_loads(low)[0][:, 0])
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = (np.sign(surrogate.root_loads(middle)[0][:, 0]) == sign)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    hair = np.array([0.0, 1e-6, 0.0, 0.0, 0.0, 0.0])
    return np.vstack([low, high, low - hair, high + hair])


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(("scene", "structure"), CASES)
def test_kernel_equals_numpy_and_torch(scene, structure, activation):
    surrogate = random_surrogate(scene_called(scene), structure, activation, seed=3)
    poses = np.vstack([random_poses(8, seed=1), far_poses(6), at_liftoff(surrogate, random_poses(2, seed=2))])
    function = surrogate.load_and_root_function(compiled=True)
    called = [function, *(function.get_function(name) for name in function.get_function())]
    assert called[-1].class_name() == "External"  # the parts' root loads are put together around it
    loads, roots = surrogate(poses), surrogate.root_loads(poses)[0]
    pose = ca.MX.sym("pose", 6)
    # The root of two_stage turns by a right angle within 0.05 N, where rounding errors of the forces count for more.
    stiff = 6 if structure == "two_stage" else 9
    for what, values, least, digits in (("loads", loads, 1.0, 9), ("roots", roots, 1e-3, stiff)):
        single = ca.Function(what, [pose], [function(pose)[what == "roots"]])
        hessian, jacobian = second_derivatives(single), single.jacobian()
        rng = np.random.default_rng(5)
        for x, value in zip(poses, values, strict=True):
            _, want_jacobian, want_hessian = torch_oracle.oracle(surrogate, x, loads=what == "loads")
            close(single(x).full().ravel(), value, digits + 3, least)
            close(jacobian(x, 0).full(), want_jacobian, digits, least)
            weights = rng.normal(size=len(value))
            got = hessian(x, weights).full()
            np.testing.assert_array_equal(got, got.T)
            close(got, np.einsum("l,lij->ij", weights, want_hessian), digits, least)


@pytest.mark.parametrize("structure", ["patch", "two_stage"])
def test_loads_and_roots_together_and_single_loads(structure):
    surrogate = random_surrogate(load_scene("knee"), structure, seed=8)
    for loads in (["Fy_lat"], ["Tx", "Fy_med"]):
        function, graph = (
            surrogate.load_and_root_function(loads, compiled=True),
            surrogate.load_and_root_function(loads),
        )
        pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("w", graph.numel_out(0) + graph.numel_out(1))

        def lagrangian(f, pose=pose, weights=weights):
            return ca.Function("l", [pose, weights], list(ca.hessian(ca.dot(weights, ca.vertcat(*f(pose))), pose)))

        got, want = lagrangian(function), lagrangian(graph)
        w = np.random.default_rng(2).normal(size=weights.numel())
        for x in random_poses(8):
            for a, b in zip(function(x), graph(x), strict=True):
                close(a, b, 12)
            for a, b in zip(got(x, w), want(x, w), strict=True):
                close(a, b, 12)


@pytest.mark.parametrize("structure", ["patch", "two_stage"])
@pytest.mark.parametrize("batch", [33])
def test_batches_equal_single_calls(structure, batch):
    surrogate = random_surrogate(load_scene("knee"), structure, seed=9)
    poses = random_poses(batch, seed=6)
    function = surrogate.load_and_root_function(compiled=True, batch=batch)
    values, roots = function(poses.T)
    close(values.full().T, surrogate(poses), 12)
    close(roots.full().T, surrogate.root_loads(poses)[0], 12)
    loads = surrogate.function(compiled=True, batch=batch)
    jacobian = loads.jacobian()(poses.T, 0)
    assert jacobian.nnz() == batch * 6 * values.shape[0]
    whole = jacobian.full().reshape(batch, values.shape[0], batch, 6)
    close(whole[range(batch), :, range(batch)], surrogate.jacobian(poses)[1], 12)

    pose = ca.MX.sym("pose", 6 * batch)
    hessians = [
        ca.Function("h", [pose], [ca.hessian(ca.sumsqr(f(ca.reshape(pose, 6, batch))), pose)[0]])
        for f in (loads, surrogate.function(batch=batch))
    ]
    got, want = (hessian(poses.ravel()) for hessian in hessians)
    assert got.nnz() == 36 * batch
    close(got, want, 10)


def test_batches_map_over_threads():
    surrogate = random_surrogate(load_scene("knee"), "patch", seed=9)
    poses = random_poses(4 * 40, seed=6)
    mapped = surrogate.function(compiled=True, batch=40).map(4, "thread")
    close(mapped(poses.T).full().T, surrogate(poses), 12)


@pytest.mark.parametrize("name", ["knee", "knee_two_stage"])
def test_ready_surrogates_agree_in_and_beyond_their_range(name):
    surrogate = load_surrogate(name)
    low, high = np.array(list(surrogate.record["pose_range"].values())).T
    rng = np.random.default_rng(1)
    inside = low + (high - low) * rng.random((200, 6))
    edges = np.where(rng.random((60, 6)) < 0.5, low, high)
    beyond = 0.5 * (low + high) + 1.5 * (high - low) * rng.uniform(-1.0, 1.0, (100, 6))
    function = surrogate.function(compiled=True, batch=360)
    poses = np.vstack([inside, edges, beyond])
    single = surrogate.function(compiled=True)
    values, jacobians = surrogate.jacobian(poses)
    usual = {"patch": 1.0, "two_stage": 1e3}[surrogate.structure]  # two_stage sums terms thousands of times their sum
    close(function(poses.T).full().T, values, 12, usual * np.abs(values).max())
    jacobian = single.jacobian()
    for pose, value, rows in zip(poses[::9], values[::9], jacobians[::9], strict=True):
        close(single(pose).full().ravel(), value, 12, usual * np.abs(values).max(axis=0).min())
        close(jacobian(pose, 0).full(), rows, 9)


def test_no_pose_however_far_gives_nan():
    surrogate = load_surrogate("knee")
    function = surrogate.function(compiled=True)
    for reach in (1e3, 1e6, 1e20, 1e200, 1e300):
        for pose in reach * np.random.default_rng(3).uniform(-1.0, 1.0, (5, 6)):
            assert np.isfinite(function(pose).full()).all()
            assert np.isfinite(function.jacobian()(pose, 0).full()).all()
