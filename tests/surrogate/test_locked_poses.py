"""A scene that locks or ties pose parameters: its networks know the free ones alone, its users whole poses."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import pose_index
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage import TwoStageSurrogate
from tests.support.agreement import agree, evaluated
from tests.support.random_surrogates import invented_samples, random_poses, random_surrogate

POSE = {"locked": {"tz": 0.4, "ry": -0.05}, "tied": {"rx": {"to": "rz", "slope": 0.02, "at_zero": 0.03}}}


def locked_knee(pose=POSE):
    tables = cc.load_scene("knee").tables
    return Scene.from_tables({**tables, "pose": pose, "loads": {**tables["loads"], "sensitive_pose": ["ty"]}})


@pytest.fixture(scope="module")
def pair():
    """A surrogate of the locked knee, and one of the free knee that gives the same loads where the first is locked."""
    scene = locked_knee()
    whole, narrow, wide = random_surrogate(cc.load_scene("knee"), "patch", seed=3), {}, {}
    free = list(scene.pose_space.free)
    for name, net in whole.networks.items():
        first, *others = net.weights
        scales = {"input_shift": net.input_shift[free], "input_scale": net.input_scale[free]}
        narrow[name] = replace(net, **scales, weights=(first[:, free], *others))
        wide[name] = replace(net, weights=(np.where(np.isin(range(6), free), first, 0.0), *others))
    return PatchSurrogate(scene, narrow), PatchSurrogate(cc.load_scene("knee"), wide)


def test_loads_and_their_derivatives_are_those_of_the_projected_pose(pair):
    locked, whole = pair
    poses, space = random_poses(9, seed=1), locked.scene.pose_space
    loads, jacobian = whole.jacobian(space.project(poses))
    got = locked.jacobian(poses)
    np.testing.assert_allclose(got[0], loads, rtol=1e-12)
    np.testing.assert_allclose(got[1], jacobian @ space.matrix, rtol=1e-10, atol=1e-9)
    roots = whole.root_loads(space.project(poses))[1] @ space.matrix
    np.testing.assert_allclose(locked.root_loads(poses)[1], roots, rtol=1e-10, atol=1e-12)
    assert (got[1][..., [pose_index("tz"), pose_index("ry"), pose_index("rx")]] == 0.0).all()


@pytest.mark.parametrize("compiled", [False, True])
def test_graph_and_kernel_agree_with_numpy_to_second_order(pair, compiled):
    locked, whole = pair
    poses, space = random_poses(5, seed=2), locked.scene.pose_space
    function = locked.load_and_root_function(compiled=compiled)
    weights = np.random.default_rng(0).normal(size=(5, len(locked.load_names)))
    by_chain = space.matrix.T @ whole.hessian(space.project(poses), weights) @ space.matrix
    many = random_poses(37, seed=4)
    agree(locked.function(compiled=compiled, batch=37)(many.T).full().T, locked(many))
    pose = ca.MX.sym("pose", 6)
    loads, roots = (ca.Function("output", [pose], [output]) for output in function(pose))
    for order, (got, want) in enumerate(
        zip(evaluated(loads, poses, weights), (*locked.jacobian(poses), by_chain[:, None]), strict=True)
    ):
        agree(got, want, order)
    for order, (got, want) in enumerate(
        zip(evaluated(roots, poses, np.ones((5, 2))), locked.root_loads(poses), strict=False)
    ):
        agree(got, want, order)


def test_two_stage_says_that_it_cannot_lock():
    assert not TwoStageSurrogate.fits(locked_knee())
    with pytest.raises(ValueError, match="use the patch structure"):
        TwoStageSurrogate.network_inputs(locked_knee())


def test_samples_off_the_locked_pose_are_refused():
    with pytest.raises(ValueError, match="is off its locked or tied value by up to"):
        PatchSurrogate.regressions(replace(invented_samples(20), scene=locked_knee()))


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ({"locked": {"tz": "middle"}}, "pose.locked.tz"),
        ({"tied": {"rx": {"to": "ry", "slope": 1.0}}, "locked": {"ry": 0.0}}, "neither locked nor tied"),
        ({"tied": {"rx": {"to": "rx", "slope": 1.0}}}, "another pose parameter"),
        ({"locked": {"ty": 27.0}}, "loads.sensitive_pose"),
        ({"locked": dict.fromkeys(("tx", "ty", "tz", "rx", "ry", "rz"), 0.0)}, "at least one pose parameter"),
    ],
)
def test_a_bad_pose_table_is_refused_by_its_key(pose, said):
    with pytest.raises(ValueError, match=said):
        locked_knee(pose)
