"""NumPy = CasADi graph = compiled kernel in values and both derivatives, everywhere a pose may go."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.core.conventions import local_poses
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.load import load_surrogate
from tests.support.agreement import (
    CANCELLED,
    agree,
    by_hessians,
    by_jacobian_of_jacobian,
    check_hessians,
    check_jacobian,
    evaluated,
)
from tests.support.compiler import needs_compiler
from tests.support.meshes import ball_mesh, scene_of, sheet_mesh
from tests.support.random_surrogates import (
    POSE_CENTRE,
    POSE_SPREAD,
    THREE,
    random_poses,
    random_surrogate,
    scene_called,
)

pytestmark = needs_compiler
CASES = [("knee", "two_stage"), *((scene, "patch") for scene in ("knee", "hip", "patellofemoral", THREE))]


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


@pytest.mark.parametrize(("scene", "structure"), CASES)
def test_graph_and_kernel_equal_numpy(scene, structure):
    """Loads and root loads, their Jacobians and Hessians, near and far, on both sides of liftoff, and not finite."""
    surrogate = random_surrogate(scene_called(scene), structure, seed=3)
    touching = at_liftoff(surrogate, random_poses(1, seed=2))
    poses, pose = np.vstack([random_poses(6, seed=1), far_poses(5), touching]), ca.MX.sym("pose", 6)
    graph, kernel = (surrogate.load_and_root_function(compiled=compiled) for compiled in (False, True))
    # The root of two_stage turns by a right angle within 0.05 N, where rounding errors of the forces count for more.
    stiff = 1e3 if structure == "two_stage" else 1.0
    alone = {"loads": surrogate.function(compiled=True), "roots": surrogate.root_function(compiled=True)}
    for what, in_numpy, amplified in (
        ("loads", surrogate.jacobian(poses), 1.0),
        ("roots", surrogate.root_loads(poses), stiff),
    ):
        weights = np.random.default_rng(5).normal(size=in_numpy[0].shape)
        single = [ca.Function(what, [pose], [function(pose)[what == "roots"]]) for function in (graph, kernel)]
        in_graph, in_kernel = (evaluated(function, poses, weights) for function in single)
        for order, (got, want) in enumerate(zip(in_kernel, in_graph, strict=True)):
            agree(got, want, order, amplified=amplified)
        for order, want in enumerate(in_numpy):
            agree(in_graph[order], want, order, amplified=amplified)
            zero = want[:6] == 0.0  # out of contact
            np.testing.assert_array_equal(in_graph[order][:6] == 0.0, zero)
            np.testing.assert_array_equal(in_kernel[order][:6] == 0.0, zero)
        agree([alone[what](each).full().ravel() for each in poses], in_numpy[0], amplified=amplified)
        bad = np.where(np.eye(6) > 0.0, np.array([[np.nan], [np.inf], [-np.inf]] * 2), poses[0])
        for part in (part for function in single for part in evaluated(function, bad, weights[:6])):
            assert np.isnan(part).all(), "in every output and derivative"
    np.testing.assert_array_equal(surrogate(poses), surrogate.jacobian(poses)[0])


@pytest.mark.parametrize(("scene", "structure"), [("knee", "patch"), (THREE, "patch"), ("knee", "two_stage")])
def test_derivatives_are_those_of_differences(scene, structure):
    surrogate = random_surrogate(scene_called(scene), structure, seed=3)
    check_jacobian(surrogate, random_poses(20, seed=6), 1e-4)
    check_hessians(surrogate, random_poses(3, seed=7))


@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize("structure", ["patch", "two_stage"])
def test_batches_equal_single_calls(structure):
    surrogate, batch = random_surrogate(load_scene("knee"), structure, seed=9), 33
    poses = random_poses(batch, seed=6)
    function = surrogate.load_and_root_function(compiled=True, batch=batch)
    values, roots = function(poses.T)
    agree(values.full().T, surrogate(poses))
    agree(roots.full().T, surrogate.root_loads(poses)[0])
    bad = poses.copy()
    bad[::5, 1] = np.nan
    values = function(bad.T)[0].full().T
    agree(values[np.isfinite(bad).all(axis=1)], surrogate(poses[np.isfinite(bad).all(axis=1)]))
    assert np.isnan(values[::5]).all(), "only the bad poses of a batch give NaN"
    mapped = function.map(2, "thread")(np.vstack([poses, poses]).T)[0]
    agree(mapped.full().T[batch:], surrogate(poses))
    jacobian = function.jacobian()(poses.T, 0, 0)[0]
    assert jacobian.nnz() == batch * 6 * values.shape[1]
    whole = jacobian.full().reshape(batch, values.shape[1], batch, 6)
    agree(whole[range(batch), :, range(batch)], surrogate.jacobian(poses)[1], 1)

    pose = ca.MX.sym("pose", 6 * batch)
    hessians = [
        ca.Function("h", [pose], [ca.hessian(ca.sumsqr(f(ca.reshape(pose, 6, batch))[0]), pose)[0]])
        for f in (function, surrogate.load_and_root_function(compiled=False, batch=batch))
    ]
    got, want = (hessian(poses.ravel()) for hessian in hessians)
    assert got.nnz() == 36 * batch
    agree(got.full()[None, None], want.full()[None, None], 2)


@pytest.mark.parametrize(("scene", "structure"), [("knee", "two_stage"), (THREE, "patch")])
def test_the_jacobian_of_the_jacobian_is_the_hessian_of_every_output(scene, structure):
    """Loads and roots together, and either alone, against the graph."""
    surrogate, poses = random_surrogate(scene_called(scene), structure, seed=3), random_poses(4, seed=1)
    want = by_hessians(surrogate.load_and_root_function(compiled=False), poses)
    together = by_jacobian_of_jacobian(surrogate.load_and_root_function(compiled=True), poses)
    (loads,) = by_jacobian_of_jacobian(surrogate.function(compiled=True), poses)
    (roots,) = by_jacobian_of_jacobian(surrogate.root_function(compiled=True), poses)
    stiff = 1e3 if structure == "two_stage" else 1.0
    for got in (together, (loads, roots)):
        agree(got[0], want[0], 2)
        agree(got[1], want[1], 2, amplified=stiff)


def test_second_derivatives_of_a_batch_are_each_pose_s_own():
    surrogate, batch = random_surrogate(load_scene("knee"), "patch", seed=9), 3
    poses, pose = random_poses(batch, seed=6), ca.MX.sym("pose", 6, batch)
    single, several = (surrogate.load_and_root_function(compiled=True, batch=count) for count in (None, batch))
    i = np.arange(batch)
    for output, want in zip(several(pose), by_jacobian_of_jacobian(single, poses), strict=True):
        second = ca.Function("second", [pose], [ca.jacobian(ca.jacobian(output, pose), pose)])(poses.T)
        rows = output.shape[0]
        assert second.nnz() == batch * 36 * rows
        by_pose = second.full().reshape(batch, 6, batch, rows, batch, 6)  # a column and a row of the Jacobian, a pose
        agree(by_pose[i, :, i, :, i].swapaxes(1, 2), want, 2)


@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize("name", ["knee", "knee_two_stage"])
def test_ready_surrogates_agree_in_and_beyond_their_range(name):
    surrogate = load_surrogate(name)
    low, high = np.array(list(surrogate.record["pose_range"].values())).T
    rng = np.random.default_rng(1)
    inside = low + (high - low) * rng.random((24, 6))
    edges = np.where(rng.random((12, 6)) < 0.5, low, high)
    beyond = 0.5 * (low + high) + 1.5 * (high - low) * rng.uniform(-1.0, 1.0, (12, 6))
    function = surrogate.function(compiled=True, batch=48)
    poses = np.vstack([inside, edges, beyond])
    values, jacobians = surrogate.jacobian(poses)
    amplified = CANCELLED[surrogate.structure]
    agree(function(poses.T).full().T, values, amplified=amplified)
    slopes = function.jacobian()(poses.T, 0).full().reshape(48, len(surrogate.load_names), 48, 6)
    agree(slopes[range(48), :, range(48)], jacobians, 1, amplified=amplified)
    far = np.geomspace(1e3, 1e300, 48) * rng.uniform(-1.0, 1.0, (6, 48))
    assert np.isfinite(function(far).full()).all(), "no pose, however far, gives NaN"
    assert np.isfinite(function.jacobian()(far, 0).full()).all()


@pytest.mark.usefixtures("as_shipped")
def test_however_many_patches_are_pressed_the_kernel_equals_numpy():
    """Networks are evaluated in pairs, and one that is left over alone."""
    surrogate, pose = random_surrogate(scene_called(THREE), "patch", seed=5), ca.MX.sym("pose", 6)
    poses = random_poses(5000, seed=7)
    pressed = sum(each.root.value(local_poses(poses, each.anchor_mm)) > 0.0 for each in surrogate.patches)
    poses = np.vstack([poses[pressed == count][:3] for count in range(4)])
    assert len(poses) == 12
    compiled, graph = (surrogate.function(compiled=compiled) for compiled in (True, False))
    slopes = ca.Function("slopes", [pose], [ca.jacobian(graph(pose), pose)])
    agree([compiled(each).full().ravel() for each in poses], surrogate(poses))
    jacobian = compiled.jacobian()
    agree([jacobian(each, 0).full() for each in poses], [slopes(each).full() for each in poses], 1)


def test_patches_may_be_called_as_the_kernel_calls_its_own(tmp_path):
    patches = "[geometry.patches.kernel]\nx = [-4.0, 0.0]\n[geometry.patches.roots]\nx = [0.0, 4.0]\n"
    scene = scene_of(tmp_path, ball_mesh(8.0, 2.0), sheet_mesh(8.0, 2.0), extra=patches)
    surrogate, poses = random_surrogate(scene, "patch", seed=3), random_poses(5, seed=1)
    function = surrogate.function(compiled=True)
    assert function.class_name() == "External", "a graph takes the place of a kernel that does not compile"
    agree([function(each).full().ravel() for each in poses], surrogate(poses))
