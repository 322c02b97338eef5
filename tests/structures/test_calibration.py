"""Calibration on a made-up truth: a known surrogate plus known noise on a known region of poses."""

import numpy as np
import pytest

from casadi_contact.dataset import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes import load_scene
from casadi_contact.structures import load_surrogate, with_trust
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD, random_surrogate

SCENE = load_scene("sphere_on_plane")
NOISE = 0.02


def made_up_samples(surrogate, count=6000, noise=NOISE, seed=0):
    """Poses on a curved tube in tx and rz; wrenches of the surrogate times (1 + noise)."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-1.0, 1.0, (count, 6))
    unit[:, 0] = 2.0 * unit[:, 5] ** 2 - 1.0 + 0.1 * unit[:, 0]
    poses = POSE_CENTRE + POSE_SPREAD * unit
    wrenches = surrogate.wrenches(poses) * (1.0 + noise * rng.standard_normal((count, 1, 1)))
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.6, 0.2, 0.2]).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    return Samples(SCENE, poses, wrenches, np.full((count, 1), np.nan), domain, role)


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(SCENE, "patch", seed=3)


def test_the_stated_share_of_unseen_errors_lies_below(surrogate):
    samples = made_up_samples(surrogate)
    trusted = with_trust(surrogate, samples)
    coverage = trusted.info().coverage["D1"]
    assert coverage["valid"] > 0.98
    for load in trusted.load_names:
        assert 0.92 < coverage[load] < 0.98
    noisier = with_trust(surrogate, made_up_samples(surrogate, noise=3.0 * NOISE))
    poses = samples.poses[:500]
    ratio = noisier.expected_error(poses) / trusted.expected_error(poses)
    assert 2.0 < np.median(ratio) < 4.5


def test_a_tube_is_a_tube_not_a_box(surrogate):
    """tx and rz lie each within its range, but together they were never sampled."""
    trusted = with_trust(surrogate, made_up_samples(surrogate))
    bottom, off = POSE_CENTRE.copy(), POSE_CENTRE.copy()
    bottom[0] -= POSE_SPREAD[0]
    off[0] += 0.9 * POSE_SPREAD[0]
    root = 0.5 * (trusted.trust.root_low + trusted.trust.root_high)[None]
    assert trusted.trust.validity(bottom[None], root)[0] > 0.9
    assert trusted.trust.validity(off[None], root)[0] < 0.1


def test_validity_survives_the_file(surrogate, tmp_path):
    trusted = with_trust(surrogate, made_up_samples(surrogate, count=1000))
    trusted.save(tmp_path / "it.h5")
    again = load_surrogate(tmp_path / "it.h5")
    poses = POSE_CENTRE + 2.0 * POSE_SPREAD * np.random.default_rng(2).uniform(-1.0, 1.0, (50, 6))
    np.testing.assert_array_equal(again.validity(poses), trusted.validity(poses))
    np.testing.assert_array_equal(again.expected_error(poses), trusted.expected_error(poses))
    assert again.info().coverage == trusted.info().coverage


def test_what_cannot_be_calibrated_is_named(surrogate):
    samples = made_up_samples(surrogate, count=300)
    with pytest.raises(ValueError, match="no validation rows"):
        with_trust(surrogate, samples.select(role=TRAIN))
    other = random_surrogate(load_scene("sphere_on_plane", radius=20.0), "patch")
    with pytest.raises(ValueError, match="another scene"):
        with_trust(other, samples)
