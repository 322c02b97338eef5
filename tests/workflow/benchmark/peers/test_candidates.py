"""All peers in one run: each family is there, what fails says why, and every stopwatch runs."""

import numpy as np
import pytest

from casadi_contact.samples.samples import TEST
from casadi_contact.workflow.benchmark.peers.candidates import FAMILIES, peer_candidates
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from tests.support.smooth_samples import NAMES, smooth_poses, smooth_samples


def test_every_family_is_in_the_table_and_every_stopwatch_runs():
    made = list(peer_candidates(smooth_samples(100), gflop=1.0, names=NAMES))
    for family in FAMILIES:
        assert any(c.family.startswith(family) for c in made), family
    poses = smooth_poses(4, seed=1)
    for candidate in made:
        assert (candidate.model is None) == bool(candidate.failure), candidate
        if candidate.model is None:
            continue
        loads = candidate.model(poses)
        assert loads.shape == (4, 3)
        assert np.isfinite(loads).all()
        assert (loads[:, 0] <= 0.0).all(), "contact cannot pull"
        for stopwatch in (
            candidate.time_value,
            candidate.time_jacobian,
            candidate.time_hessian,
            candidate.time_batch,
        ):
            assert stopwatch is None or stopwatch(poses) > 0.0


def test_a_family_that_breaks_does_not_end_the_run(monkeypatch):
    def broken(data, gflop):
        raise RuntimeError("out\nof order")
        yield

    monkeypatch.setattr("casadi_contact.workflow.benchmark.peers.candidates.radial_basis", broken)
    made = list(peer_candidates(smooth_samples(300), gflop=1.0, families=["radial basis", "polynomial"]))
    assert made[0].failure == "out of order"
    assert any(c.model is not None for c in made[1:])


def test_no_test_or_validation_sample_is_fitted():
    samples = smooth_samples(300)
    data = TrainingSet.of(samples, NAMES)
    held = samples.select(role=TEST).poses
    assert len(data) == 240
    assert not (data.poses[:, None, :] == held).all(axis=2).any()
    some = TrainingSet.of(samples.select(domain="D1"), NAMES)
    assert len(some) < len(data)


def test_domains_are_named():
    made = list(peer_candidates(smooth_samples(300), gflop=1.0, domains=["D1"], families=["polynomial"]))
    assert made[0].name == "polynomial 2 (D1)"
    assert made[0].samples == 160


def test_mistakes_are_refused_in_words():
    with pytest.raises(ValueError, match="unknown peer 'magic'"):
        peer_candidates(smooth_samples(100), gflop=1.0, families=["magic"])
    with pytest.raises(ValueError, match="expected 10⁹ operations, above 0"):
        peer_candidates(smooth_samples(100), gflop=0.0)
    with pytest.raises(ValueError, match="unknown load 'Fq'"):
        peer_candidates(smooth_samples(100), gflop=1.0, names=["Fq"])
