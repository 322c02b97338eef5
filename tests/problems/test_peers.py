"""Peers: each family is in the table, learns what it should, and what fails says why."""

import sys

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import TEST
from casadi_contact.samples.settings import SamplePoint
from problems.studies.peers import (
    FAMILIES,
    HISTORY,
    TrainingSet,
    history_candidates,
    peer_candidates,
    regressor_candidates,
)
from tests.support.smooth_samples import NAMES, SPHERE, smooth_poses, smooth_samples, smooth_wrenches


def test_every_family_is_in_the_table_and_every_stopwatch_runs():
    pytest.importorskip("sklearn")
    made = list(peer_candidates(smooth_samples(100), None, 1.0, NAMES))
    poses = smooth_poses(4, seed=1)
    assert {c.point.family for c in made} == set(FAMILIES)
    for candidate in (c for c in made if c.model is not None):
        loads = candidate.model(poses)
        assert loads.shape == (4, 3)
        assert np.isfinite(loads).all()
        assert set(candidate.stopwatches) == {"value", "batch"}
        assert all(stopwatch(poses) > 0.0 for stopwatch in candidate.stopwatches.values())
    failures = {c.point.family: c.point.failure for c in made if c.model is None}
    assert set(failures) == {HISTORY}
    assert "motion" in failures[HISTORY]


def test_without_scikit_learn_it_says_what_to_install(monkeypatch):
    for name in ("sklearn", "sklearn.pipeline", "sklearn.neighbors"):
        monkeypatch.setitem(sys.modules, name, None)
    (only,) = peer_candidates(smooth_samples(100), None, 1.0, families=["neighbours"])
    assert only.model is None
    assert "scikit-learn" in only.point.failure or "sklearn" in only.point.failure


def test_no_test_or_validation_sample_is_fitted():
    samples = smooth_samples(300)
    data = TrainingSet.of(samples, NAMES)
    assert len(data) == 240
    assert not (data.poses[:, None, :] == samples.select(role=TEST).poses).all(axis=2).any()


@pytest.mark.parametrize(
    ("family", "share"), [("polynomial", 0.02), ("Gaussian process", 0.05), ("neighbours", 0.5), ("radial basis", 0.1)]
)
def test_regressors_predict_unseen_points_of_a_smooth_function(family, share):
    pytest.importorskip("sklearn")
    data = TrainingSet.of(smooth_samples(600), NAMES)
    poses = smooth_poses(100, seed=6)
    want = smooth_wrenches(poses)[:, 0, [1, 0, 3]]
    off = [np.sqrt(((c.model(poses) - want) ** 2).mean(axis=0)) for c in regressor_candidates(family, data, 1.0)]
    assert (np.min(off, axis=0) < share * data.loads.std(axis=0)).all()


@pytest.mark.parametrize(
    ("scene", "names", "want"),
    [
        ("knee", ("Fy_med", "Tx"), [[-7.0, 7.0], [0.0, -7.0]]),  # presses downwards
        ("patellofemoral", ("Fx_lat", "Tz"), [[0.0, 7.0], [7.0, -7.0]]),  # presses forwards
        ("hip", ("Fx", "Fy"), [[-7.0, 7.0], [7.0, -7.0]]),  # presses anywhere
    ],
)
def test_a_load_that_would_pull_is_clamped_to_zero(scene, names, want):
    data = TrainingSet(cc.load_scene(scene), names, np.zeros((1, 6)), np.zeros((1, 2)))
    np.testing.assert_array_equal(data.without_pull(np.array([[-7.0, 7.0], [7.0, -7.0]])), want)


def rolling_motion(cycles, frames=41):
    """A sphere that rolls and presses, a little differently in each cycle."""
    share = np.linspace(0.0, 1.0, frames)
    poses = np.zeros((cycles, frames, 6))
    for k in range(cycles):
        wave = 2.0 * np.pi * share + 0.05 * k
        poses[k, :, 0] = 6.0 * np.sin(wave)
        poses[k, :, 1] = 29.85 + 0.08 * np.cos(wave) * (1.0 + 0.02 * k)
        poses[k, :, 5] = -0.2 * np.sin(wave)
    point = SamplePoint(("tx", "Fy", "tz", "rx", "ry", "rz"))
    return ReferenceMotion(point, np.zeros((cycles, frames, 6)), poses)


def test_a_history_model_follows_an_unseen_cycle_and_rests_where_a_motion_rests():
    data = TrainingSet.of(smooth_samples(100), ("Fy",))
    sequence, single = (c.model for c in history_candidates(data, 1.0, rolling_motion(7)))
    unseen = rolling_motion(7).poses[3:5].mean(axis=0)
    want = cc.ElasticFoundation(SPHERE, SPHERE.grids["teacher"])(unseen)[:, [SPHERE.load_names.index("Fy")]]
    assert np.sqrt(np.mean((sequence(unseen) - want) ** 2)) < 0.05 * want.std()
    still = np.repeat(unseen[7:8], 41, axis=0)
    np.testing.assert_allclose(sequence(still), np.repeat(single(still[:1]), 41, axis=0), rtol=1e-3)
