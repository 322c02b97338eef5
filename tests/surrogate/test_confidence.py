"""Validity and expected error of the shipped knee: smooth, honest far outside, cover unseen walking."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.walking import reference_cycles
from casadi_contact.workflow.benchmark.measure import unseen_walking
from tests.support.random_surrogates import random_surrogate


@pytest.fixture(scope="module")
def walking(knee):
    """Poses of walking cycles in between the built-in ones, none of which is a sample."""
    settings = SamplingSettings.from_scene(knee.scene)
    model = cc.ElasticFoundation(knee.scene, (40, 30))
    motion, _ = reference_motion(model, reference_cycles(), settings)
    return unseen_walking(model, motion, count=2, seed=8)


def ranged_poses(knee, count, times, seed=0):
    """Random poses of `times` the sampled range of every pose parameter."""
    low, high = np.array([knee.record["pose_range"][name] for name in POSE_NAMES]).T
    unit = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6))
    return 0.5 * (low + high) + times * 0.5 * (high - low) * unit


def test_derivatives_in_mx_and_sx_are_the_same(knee, walking):
    """On a line from walking out of the learned region, across the edge, where g switches on."""
    for function in (knee.validity_function(), knee.expected_error_function()):
        in_mx, in_sx = (
            ca.Function("all", [pose], [function(pose)[0], *ca.hessian(function(pose)[0], pose)])
            for pose in (ca.MX.sym("pose", 6), ca.SX.sym("pose", 6))
        )
        line = [walking[30] + np.array([0.0, 0.0, t, 0.0, 0.0, 0.0]) for t in np.linspace(0.0, 3.0, 7)]
        for at in line:
            for sx, mx in zip(in_sx(at), in_mx(at), strict=True):
                np.testing.assert_allclose(sx.full(), mx.full(), rtol=1e-12)
        scales = knee.confidence.scales
        assert max(np.abs(in_mx(at)[1].full() * np.outer(scales, scales)).max() for at in line) > 0.1, "the edge"


@pytest.mark.parametrize("name", ["tx", "tz", "ry", "rz"])
def test_validity_falls_and_the_error_grows_on_the_way_out(knee, walking, name):
    """Insensitive pose parameters leave the tube: half the sampled range beyond its end nothing is known any more."""
    low, high = knee.record["pose_range"][name]
    poses = np.repeat(walking[30:31], 60, axis=0)
    column = POSE_NAMES.index(name)
    poses[:, column] = np.linspace(poses[0, column], high + 0.5 * (high - low), 60)
    validity, error = knee.validity(poses), knee.expected_error(poses)
    assert validity[0] > 0.98
    assert validity[-1] < 0.02
    outside = np.flatnonzero(validity < 0.5)
    assert (validity[outside[0] :] < 0.5).all(), "once outside, it stays outside"
    assert (error[-1] > 10.0 * error[0]).all()
    deeper, off = walking[30] + np.array([[0.0, -1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 8.0, 0.0, 0.0, 0.0, 0.0]])
    assert knee.validity([deeper, off]).max() < 0.05, "pressed deeper than any sample, or lifted off further"


def test_no_pose_far_away_is_called_valid(knee):
    """To three times the learned range: finite, never pulling, no contact beyond gaps of 3 mm unless not valid."""
    poses = ranged_poses(knee, 20_000, 3.0)
    normal = -knee(poses)[:, :2]
    validity, error = knee.validity(poses), knee.expected_error(poses)
    assert np.isfinite(normal).all()
    assert np.isfinite(validity).all()
    assert np.isfinite(error).all()
    assert normal.min() >= 0.0
    gaps = cc.ElasticFoundation(knee.scene, (40, 20)).gaps(poses)
    false_contact = ((normal > 0.0) & (gaps > 3.0)).any(axis=1)
    assert false_contact.any(), "there is something to warn of"
    assert validity[false_contact].max() < 0.5


@pytest.mark.parametrize("far", [1e3, 1e12])
def test_any_distance_gives_numbers(knee, far):
    poses = far * np.random.default_rng(1).standard_normal((50, 6))
    assert knee.validity(poses).max() < 1e-4
    assert np.isfinite(knee.expected_error(poses)).all()
    pose = ca.MX.sym("pose", 6)
    both = ca.vertcat(knee.validity_function()(pose), knee.expected_error_function()(pose))
    derivative = ca.Function("d", [pose], [both, ca.jacobian(both, pose)])
    for p in poses[:5]:
        assert all(np.isfinite(np.asarray(part)).all() for part in derivative(p))
        assert all(np.isnan(np.asarray(part)).all() for part in derivative(np.r_[p[:5], np.inf]))


@pytest.mark.parametrize("name", ["knee", "knee_two_stage"])
def test_expected_error_covers_poses_moved_around_unseen_walking(name, walking):
    """1 mm and 2 degrees off: of at least 93 % of the valid ones' errors; no valid pose errs by much more."""
    surrogate, rng = cc.load_surrogate(name), np.random.default_rng(19)
    assert surrogate.validity(walking).min() > 0.9
    count = 2000
    moves = np.vstack([rng.uniform(-1.0, 1.0, (count, 6)), rng.standard_normal((count, 6))])
    poses = walking[rng.integers(len(walking), size=2 * count)] + moves * np.repeat([1.0, np.deg2rad(2.0)], 3)
    poses = poses[surrogate.validity(poses) > 0.5]
    teacher = cc.ElasticFoundation(surrogate.scene, surrogate.scene.grids["teacher"])
    poses = poses[~teacher.at_edge(poses).any(axis=1)]
    loads = teacher(poses)
    errors, carried = np.abs(surrogate(poses) - loads), loads != 0.0
    assert carried.sum() > 500
    below = errors <= surrogate.expected_error(poses)
    assert np.mean(below[carried]) >= 0.93
    for column, rows in zip(below.T, carried.T, strict=True):
        assert column[rows].mean() > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / rows.sum())
    assert errors[:, :2].max() < (100.0 if name == "knee" else 60.0)


def test_ipopt_keeps_to_the_learned_region_and_comes_back_to_it(knee, walking):
    """Drawn to a pose far outside, the solution ends on the constraint, from a start inside and from one outside."""
    frame, scales = 10, knee.confidence.scales
    drawn = walking[frame] + 4.0 * scales * np.eye(6)[POSE_NAMES.index("ry")]
    x = ca.MX.sym("x", 6)
    nlp = {"x": x, "f": ca.sumsqr(x - drawn / scales), "g": 1.0 / knee.validity_function()(x * scales)}
    solver = ca.nlpsol("s", "ipopt", nlp, {"ipopt": {"print_level": 0, "sb": "yes"}, "print_time": False})
    for start in (walking[frame], 0.5 * (walking[frame] + drawn)):
        answer = solver(x0=start / scales, lbg=1.0, ubg=2.0)
        assert solver.stats()["success"]
        assert float(answer["g"]) == pytest.approx(2.0, abs=1e-5)
    assert knee.validity(drawn[None])[0] < 0.1


def test_a_surrogate_without_calibration_says_how_to_get_one():
    surrogate = random_surrogate(cc.load_scene("sphere_on_plane"), "patch")
    for ask in (surrogate.validity, surrogate.expected_error):
        with pytest.raises(ValueError, match="calibrate"):
            ask(np.zeros((1, 6)))
    with pytest.raises(ValueError, match="build it again"):
        surrogate.validity_function()
    assert "not calibrated" in str(surrogate.info())
