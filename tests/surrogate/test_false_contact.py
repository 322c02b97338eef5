"""Around walking, 1 mm and 2 degrees off: no pose where nothing touches is valid and claims contact."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES


@pytest.fixture(scope="module")
def moved():
    """Poses of static equilibrium over flexion, moved, and the wrenches of the foundation there."""
    scene = cc.load_scene("knee")
    model = cc.ElasticFoundation(scene, scene.grids["coarse"])
    rng = np.random.default_rng(4)
    starts = np.zeros((200, 6))
    starts[:, POSE_NAMES.index("ty")] = 27.3
    starts[:, POSE_NAMES.index("rz")] = -np.deg2rad(rng.uniform(0.0, 60.0, len(starts)))
    loads = {name: -rng.uniform(50.0, 900.0, len(starts)) for name in ("Fy_med", "Fy_lat")}
    poses, report = cc.settle(model, starts, free=("ty", "rx"), targets=loads)
    poses = np.repeat(poses[report.converged], 10, axis=0)
    poses = poses + rng.uniform(-1.0, 1.0, poses.shape) * np.repeat([1.0, np.deg2rad(2.0)], 3)
    return poses, model(poses)


@pytest.mark.parametrize(("name", "most"), [("knee", 0.0), ("knee_two_stage", 0.1)])
def test_few_false_contacts_are_valid(name, most, moved):
    """Of poses where nothing touches and the surrogate gives a load, at most this share is called valid."""
    poses, loads = moved
    surrogate = cc.load_surrogate(name)
    untouched = (loads == 0.0).all(axis=1)
    assert untouched.sum() > 300
    false = untouched & (np.abs(surrogate(poses, ["Fy_med", "Fy_lat"])) > 1.0).any(axis=1)
    assert (false & (surrogate.validity(poses) > 0.5)).sum() <= most * false.sum()


@pytest.mark.parametrize("name", ["knee", "knee_two_stage"])
def test_beyond_the_sampled_flexion_valid_poses_are_accurate(name, moved):
    """Both were sampled to 88 degrees: beyond, at most 2 % of the poses are valid and off by five tolerances."""
    poses = moved[0][::4].copy()
    poses[:, POSE_NAMES.index("rz")] = -np.deg2rad(np.random.default_rng(5).uniform(95.0, 130.0, len(poses)))
    surrogate = cc.load_surrogate(name)
    valid = surrogate.validity(poses) > 0.5
    off = np.abs(surrogate(poses) - cc.foundation(surrogate.scene)(poses))
    wrong = (off > 5.0 * surrogate.scene.tolerances_of(surrogate.load_names)).any(axis=1)
    assert (valid & wrong).mean() < 0.02


def test_errors_of_light_contact_are_expected():
    """As every contact begins and ends; errors there are as large as under loads a hundred times as large."""
    surrogate = cc.load_surrogate("knee")
    model, rng = cc.foundation(surrogate.scene), np.random.default_rng(3)
    starts = np.zeros((600, 6))
    starts[:, POSE_NAMES.index("ty")] = 27.3
    for name, most in (("tx", 4.0), ("tz", 1.0), ("ry", 0.08)):
        starts[:, POSE_NAMES.index(name)] = rng.uniform(-most, most, len(starts))
    starts[:, POSE_NAMES.index("rz")] = -np.deg2rad(rng.uniform(0.0, 60.0, len(starts)))
    loads = {name: -np.exp(rng.uniform(np.log(5.0), np.log(60.0), len(starts))) for name in ("Fy_med", "Fy_lat")}
    poses, report = cc.settle(model, starts, free=("ty", "rx"), targets=loads)
    poses = poses[report.converged]
    poses = poses[surrogate.validity(poses) > 0.9]
    assert len(poses) > 300
    below = np.abs(surrogate(poses) - model(poses)) <= surrogate.expected_error(poses)
    assert below.mean() > 0.93
