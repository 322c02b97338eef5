"""Where a surrogate is wrong: poses between samples, at which it carries loads and its contact model has none."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.approach import advance_to_contact
from casadi_contact.samples.led_to import poses_led_to, samples_led_to
from casadi_contact.samples.perturbed import label_poses
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.wrong_poses import with_error_classifier
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD, random_surrogate

SCENE = load_scene("sphere_on_plane")


class Rimmed:
    """A contact model that says what the surrogate says, and nothing beyond a curved rim in tx and tz."""

    def __init__(self, surrogate):
        self.surrogate = surrogate

    def on_the_plane(self, poses):
        unit = (poses - POSE_CENTRE) / POSE_SPREAD
        return unit[:, 2] < 0.5 - 0.5 * unit[:, 0] ** 2

    def wrenches(self, poses):
        return self.surrogate.wrenches(poses) * self.on_the_plane(poses)[:, None, None]

    def at_edge(self, poses):
        return ~self.on_the_plane(poses)[:, None]


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(SCENE, "patch", seed=3)


@pytest.fixture(scope="module")
def model(surrogate):
    return Rimmed(surrogate)


@pytest.fixture(scope="module")
def samples(surrogate, model):
    """Of poses on the plane alone: a contact that reaches the rim is dropped from a plan."""
    rng = np.random.default_rng(0)
    poses = POSE_CENTRE + POSE_SPREAD * rng.uniform(-1.0, 1.0, (6000, 6))
    poses = poses[model.on_the_plane(poses)]
    role = rng.choice([TRAIN, VALIDATION, TEST], len(poses), p=[0.6, 0.2, 0.2]).astype(np.uint8)
    nothing, domain = np.full((len(poses), 1), np.nan), np.ones(len(poses), dtype=np.uint8)
    return Samples(SCENE, poses, model.wrenches(poses), nothing, domain, role)


def other_poses(surrogate, seed, count=4000):
    """Poses over the whole range at which the surrogate presses."""
    poses = POSE_CENTRE + POSE_SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, (2 * count, 6))
    return poses[surrogate.trust_roots(poses)[:, 0] > 0.3][:count]


@pytest.fixture(scope="module")
def learning():
    """How far a classifier is learned, as it tells."""
    return []


@pytest.fixture(scope="module")
def classified(surrogate, model, samples, learning):
    trusted = with_trust(surrogate, samples)
    shown = label_poses(model, SCENE, other_poses(surrogate, 1), rim=True)
    trust = with_error_classifier(trusted.trust, surrogate, samples, [shown], lambda k, n: learning.append(k / n))
    return type(surrogate)(SCENE, surrogate.networks, trusted.record, trust)


def test_poses_are_not_valid_where_the_surrogate_is_wrong(surrogate, model, samples, classified):
    poses = other_poses(surrogate, 2)
    right = model.on_the_plane(poses)
    before, after = (made.validity(poses) > 0.5 for made in (with_trust(surrogate, samples), classified))
    assert before[~right].mean() > 0.3, "distance from the samples does not tell these poses"
    assert after[~right].mean() < 0.03
    assert (after & right).sum() > 0.9 * (before & right).sum()
    assert np.mean(classified.validity(samples.poses) > 0.9) > 0.95


def test_a_surrogate_that_knows_no_rim_leads_over_it_and_the_contact_model_is_asked_there(surrogate, model, samples):
    led = samples_led_to(surrogate, samples, model, count=300)
    beyond = ~model.on_the_plane(led.poses)
    assert beyond.sum() > 10
    assert np.median(surrogate.trust_roots(led.poses[beyond])) > 0.1, "it presses over the rim as elsewhere"
    assert (led.wrenches[beyond] == 0.0).all()
    assert len(led) == len(poses_led_to(surrogate, samples, count=300)), "none of them is dropped"


def test_each_step_of_a_calibration_tells_how_far_it_is(surrogate, model, samples, classified, learning):
    told = {"where it is wrong": learning}
    with_trust(
        surrogate,
        samples,
        model=model,
        update=lambda what, done, total, remark: told.setdefault(what, []).append(done / total),
    )
    assert {"patch: poses over the range", "patch: poses it leads to"} <= set(told)
    assert list(told)[-1] == "patch: expected errors"
    for shares in told.values():
        assert shares == sorted(shares), "a bar never goes back"
        assert shares[-1] == 1.0
    assert len(learning) > 10


def test_the_file_keeps_the_classifier_and_casadi_says_the_same(surrogate, classified, tmp_path):
    classified.save(tmp_path / "it.h5")
    poses = other_poses(surrogate, 3, count=40)
    again = load_surrogate(tmp_path / "it.h5")
    np.testing.assert_array_equal(again.validity(poses), classified.validity(poses))
    validity = classified.validity_function()
    np.testing.assert_allclose([float(validity(pose)) for pose in poses], classified.validity(poses), atol=1e-12)


def test_a_surrogate_that_is_right_everywhere_has_no_classifier(surrogate, samples):
    right = replace(samples, wrenches=surrogate.wrenches(samples.poses))
    trust = with_trust(surrogate, right).trust
    poses = other_poses(surrogate, 1)
    assert with_error_classifier(trust, surrogate, right, [label_poses(surrogate, SCENE, poses)]).classifier is None


def test_one_gross_error_on_a_validation_row_hides_no_other_wrong_pose(surrogate, model, samples, classified):
    """Beyond the rim all of a load is missing, and one lifted pose claims ten thousand times as much."""
    wrenches = samples.wrenches.copy()
    wrenches[np.flatnonzero(samples.role == VALIDATION)[0]] *= 1e4
    shown = label_poses(model, SCENE, other_poses(surrogate, 1), rim=True)
    gross = replace(samples, wrenches=wrenches)
    trust = with_error_classifier(with_trust(surrogate, samples).trust, surrogate, gross, [shown])
    assert trust.classifier is not None
    poses = other_poses(surrogate, 2)
    wrong = ~model.on_the_plane(poses)
    validity = type(surrogate)(SCENE, surrogate.networks, classified.record, trust).validity(poses)
    assert (validity[wrong] > 0.5).mean() < 0.03


def test_poses_led_to_carry_loads_of_samples_from_all_over_the_range():
    """On a foundation, which leads where it stands itself: each side carries some sample's load, or a part of one."""
    model = cc.foundation(cc.load_scene("knee"))
    rng = np.random.default_rng(0)
    drawn = advance_to_contact(model, rng.uniform(-1.0, 1.0, (400, 6)) * [2.0, 0.0, 1.0, 0.003, 0.03, 0.3], {})
    drawn[:, 1] -= rng.uniform(0.1, 0.3, 400)
    drawn = drawn[(model(drawn, ["Fy_med", "Fy_lat"]) < 0.0).all(axis=1)]
    role, domain = np.full(len(drawn), TRAIN, dtype=np.uint8), np.ones(len(drawn), dtype=np.uint8)
    known = label_poses(model, model.scene, drawn, rim=True)
    known = replace(known, role=role, domain=domain)
    found = poses_led_to(model, known, count=300)
    assert len(found) > 200
    for name in ("Fy_med", "Fy_lat"):
        _check_loads(-model(found, [name])[:, 0], -known.loads([name])[:, 0])
    for column in (0, 2, 4, 5):
        assert np.ptp(found[:, column]) > 0.9 * np.ptp(drawn[:, column])


def test_sides_that_share_one_sensitive_pose_parameter_are_led_by_their_total_load():
    model = cc.foundation(cc.load_scene("planar_knee"))
    rng = np.random.default_rng(1)
    drawn = advance_to_contact(model, rng.uniform(-1.0, 1.0, (200, 6)) * [2.0, 0.0, 0.0, 0.0, 0.0, 0.3], {})
    drawn[:, 1] -= rng.uniform(0.1, 0.3, 200)
    known = label_poses(model, model.scene, drawn, rim=True)
    role, domain = np.full(len(known), TRAIN, dtype=np.uint8), np.ones(len(known), dtype=np.uint8)
    found = poses_led_to(model, replace(known, role=role, domain=domain), count=100)
    assert len(found) > 70
    _check_loads(-model(found, ["Fy"])[:, 0], -known.loads(["Fy"])[:, 0])


def _check_loads(carried, sampled):
    """Three in four poses carry a sample's load; the others are lighter, some of them by far."""
    of_samples = np.abs(carried[:, None] - sampled).min(axis=1) < 0.02
    assert 0.65 < of_samples.mean() < 0.85
    assert carried.max() < sampled.max() + 0.02
    assert np.mean(carried < 0.05 * np.median(sampled)) > 0.05
