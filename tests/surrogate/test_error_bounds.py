"""Expected errors of few held-back rows, on a made-up truth."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.error_bounds import LEAST_COVERAGE, quantile_of_unseen
from tests.support.noisy_samples import SCENE, made_up_samples
from tests.support.random_surrogates import random_surrogate


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(SCENE, "patch", seed=3)


def test_of_small_tables_as_many_unseen_errors_lie_below_as_of_large_ones(surrogate):
    """A formula of four numbers passes through some of the 30 held-back rows that it is fitted to."""
    unseen = made_up_samples(surrogate, count=20_000, seed=999)
    wanted = unseen.loads(surrogate.load_names)
    errors = np.abs(surrogate(unseen.poses) - wanted)
    shares = []
    for seed in range(8):
        samples = made_up_samples(surrogate, count=300, seed=seed)
        role = np.random.default_rng(seed).choice([TRAIN, VALIDATION, TEST], 300, p=[0.8, 0.1, 0.1]).astype(np.uint8)
        trusted = with_trust(surrogate, replace(samples, role=role))
        shares.append((errors <= trusted.expected_error(unseen.poses))[wanted != 0.0].mean())
    assert np.mean(shares) > 0.95
    assert min(shares) > 0.92


@pytest.mark.parametrize("count", [60, 1000])
def test_quantiles_leave_room_for_errors_not_seen_yet(count):
    """Of exponential errors a share 1 - exp(-b) lies below b; the plain quantile is too small in half of the draws."""
    drawn = np.random.default_rng(0).exponential(size=(2000, count))
    kept = 1.0 - np.exp(-np.array([quantile_of_unseen(errors) for errors in drawn]))
    assert 0.8 < np.mean(kept >= LEAST_COVERAGE) < 0.97
    assert kept.mean() < LEAST_COVERAGE + 0.035
    assert np.mean(1.0 - np.exp(-np.quantile(drawn, LEAST_COVERAGE, axis=1)) >= LEAST_COVERAGE) < 0.6


@pytest.mark.parametrize("copies", [1, 30])
def test_loads_that_few_unseen_samples_carry_may_be_as_wrong_as_they_are_large(surrogate, copies):
    """Networks that know their few training rows by heart err by nothing there: that tells of no other pose."""
    samples = made_up_samples(surrogate, count=60, noise=0.0).rows(np.repeat(np.arange(60), copies))
    few = with_trust(surrogate, samples)
    unseen = made_up_samples(surrogate, count=2000, noise=0.3, seed=5)
    off = np.abs(surrogate(unseen.poses) - unseen.loads(surrogate.load_names))
    expected = few.expected_error(unseen.poses)
    usual = np.sqrt(np.mean(samples.select(role=TRAIN).loads(surrogate.load_names) ** 2, axis=0))
    assert (expected >= 0.999 * usual).all()
    assert (off <= expected).mean() > 0.95
