"""Beside what a scene locks and ties, where a surrogate's loads are those of another pose, it is not valid."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES, pose_index
from casadi_contact.scenes.pose_space import OFF_SPACE
from casadi_contact.surrogate.arrays import BATCH_FROM
from casadi_contact.surrogate.base import Surrogate
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.held_scenes import scene_held
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.random_trust import random_trust

POSE = {
    "locked": {"tz": 0.4, "ry": -0.05},
    "tied": {"rx": {"to": "rz", "slope": 0.02, "at_zero": 0.03}},
}
HELD = ("tz", "ry", "rx")


def with_trust(made, trust, **keys) -> Surrogate:
    return type(made)(made.scene, made.networks, made.record, trust, **keys)


@pytest.fixture(scope="module")
def surrogate():
    """A surrogate of the held knee with random networks, and a random trust."""
    made = random_surrogate(scene_held("knee", POSE, sensitive_pose=["ty"]), "patch", seed=3)
    return with_trust(made, random_trust(2, len(made.load_names)))


@pytest.fixture(scope="module")
def trusting(surrogate):
    """The same, which trusts any pose but for what the scene says."""
    far = np.full(2, 1e6)
    trust = replace(surrogate.trust, box=None, border=None, classifier=None, edge=1e6, root_low=-far, root_high=far)
    return with_trust(surrogate, trust)


def beside(surrogate, name, off, count=5):
    poses = surrogate.scene.pose_space.onto(random_poses(count, seed=2))
    poses[:, pose_index(name)] += off
    return poses


@pytest.mark.parametrize("name", HELD)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_validity_is_a_half_at_the_tolerance_and_next_to_nothing_from_twice_as_far_on(trusting, name, sign):
    on, near, at, off, far = (
        trusting.validity(beside(trusting, name, sign * share * OFF_SPACE)) for share in (0.0, 0.1, 1.0, 2.0, 300.0)
    )
    assert on.min() > 0.98
    assert near.min() > 0.98, "poses from a file with four digits are on the space"
    np.testing.assert_allclose(at, 0.5, atol=0.02)
    assert off.max() < 1e-3
    assert far.max() < 1e-6


def test_errors_are_expected_where_loads_are_those_of_another_pose(trusting):
    poses = beside(trusting, "rx", 0.02)
    held = trusting.scene.pose_space.onto(poses)
    np.testing.assert_array_equal(trusting(poses), trusting(held))
    assert (trusting.expected_error(poses) > trusting.expected_error(held) + trusting.trust.growth_loads).all()


def test_free_parameters_may_be_anything(trusting):
    poses = beside(trusting, "tx", 300.0)
    np.testing.assert_allclose(trusting.validity(poses), trusting.validity(beside(trusting, "tx", 0.0)), atol=1e-3)


def test_graph_gives_the_same_and_leads_back_to_the_space(surrogate, trusting):
    poses = np.vstack([beside(surrogate, name, off) for name in HELD for off in (0.0, 5e-4, 2e-3, 0.3)])
    for made in (surrogate, trusting):
        validity, errors = made.validity_function(), made.expected_error_function()
        np.testing.assert_allclose([float(validity(p)) for p in poses], made.validity(poses), atol=1e-12)
        got = np.array([errors(p).full().ravel() for p in poses])
        np.testing.assert_allclose(got, made.expected_error(poses), rtol=1e-9)
    pose = ca.MX.sym("pose", 6)
    distrust = 1.0 / trusting.validity_function()(pose)
    slope = ca.Function("s", [pose], [ca.gradient(distrust, pose)])
    for name in HELD:
        assert slope(beside(trusting, name, 0.3, 1)[0])[POSE_NAMES.index(name)] > 0.0
        assert slope(beside(trusting, name, -0.3, 1)[0])[POSE_NAMES.index(name)] < 0.0


@pytest.mark.parametrize("far", [1e6, 1e150])
def test_any_distance_gives_numbers(trusting, far):
    poses = far * np.random.default_rng(1).standard_normal((20, 6))
    assert trusting.validity(poses).max() < 1e-4
    assert np.isfinite(trusting.expected_error(poses)).all()


@needs_compiler
@pytest.mark.usefixtures("as_shipped")
def test_the_kernel_gives_the_same(surrogate, trusting):
    poses = surrogate.scene.pose_space.onto(random_poses(BATCH_FROM + 5, seed=1))
    rng = np.random.default_rng(5)
    poses[:, [2, 3, 4]] += rng.choice([0.0, 5e-4, 2e-3, 0.3], (len(poses), 3)) * rng.uniform(-1.0, 1.0, (len(poses), 3))
    for made in (surrogate, trusting):
        kernel = with_trust(made, made.trust, compiled=True)
        close(kernel.validity(poses), made.validity(poses), 9)
        close(kernel.expected_error(poses), made.expected_error(poses), 9)


def test_a_file_needs_not_hold_what_its_scene_says(trusting, tmp_path):
    """So that files of before say so too."""
    trusting.save(tmp_path / "held.h5")
    assert not any("off_space" in name for name in trusting.trust.numbers())
    poses = np.vstack([beside(trusting, "rx", off) for off in (0.0, 2e-3)])
    again = cc.load_surrogate(tmp_path / "held.h5")
    np.testing.assert_array_equal(again.validity(poses), trusting.validity(poses))
