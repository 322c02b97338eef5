"""Kriging interpolates its points, its written-out sums are scikit-learn's, and what ends its growth is kept."""

import sys

import numpy as np
import pytest

from casadi_contact.workflow.benchmark.peers.candidates import peer_candidates
from casadi_contact.workflow.benchmark.peers.growth import grow
from casadi_contact.workflow.benchmark.peers.kriging import Kriging, fit_gflop, kriging, tuned_kernel
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from tests.support.smooth_samples import NAMES, SPREAD, differences, smooth_poses, smooth_samples, smooth_wrenches

process = pytest.importorskip("sklearn.gaussian_process", reason="scikit-learn is not installed")
kernels = process.kernels

SMOOTH_KERNEL = kernels.ConstantKernel(10.0) * kernels.Matern(np.full(6, 3.0), nu=2.5) + kernels.WhiteKernel(1e-10)


@pytest.fixture(scope="module")
def data():
    return TrainingSet.of(smooth_samples(600), NAMES)


def test_it_interpolates_its_points(data):
    model = Kriging(data, 300, SMOOTH_KERNEL)
    np.testing.assert_allclose(model(data.poses[:300]), data.loads[:300], atol=1e-5 * data.load_scale[1].max())
    assert 1e3 < model.condition < 1e12


def test_condition_number_is_that_of_the_kernel_matrix(data):
    model = Kriging(data, 200, SMOOTH_KERNEL)
    matrix = SMOOTH_KERNEL((data.poses[:200] - data.centre) / data.spread) + 1e-10 * np.eye(200)
    assert model.condition == pytest.approx(np.linalg.cond(matrix, 1), rel=0.5)


def test_single_poses_batches_and_scikit_learn_agree(data):
    model, poses = Kriging(data, 300, SMOOTH_KERNEL), smooth_poses(20, seed=4)
    mean, deviation = data.load_scale
    reference = process.GaussianProcessRegressor(SMOOTH_KERNEL, optimizer=None)
    reference.fit((data.poses[:300] - data.centre) / data.spread, (data.loads[:300] - mean) / deviation)
    want = reference.predict((poses - data.centre) / data.spread) * deviation + mean
    np.testing.assert_allclose(model(poses), want, atol=1e-7 * deviation.max())
    np.testing.assert_allclose([model.one(pose).copy() for pose in poses], want, atol=1e-7 * deviation.max())


def test_jacobian_is_the_slope_of_the_value(data):
    model = Kriging(data, 300, SMOOTH_KERNEL)
    for pose in smooth_poses(4, seed=5):
        by_steps = differences(lambda p: model.one(p).copy(), pose, 1e-3 * SPREAD)
        np.testing.assert_allclose(model.jacobian_one(pose), by_steps, rtol=1e-3, atol=1e-4 * np.abs(by_steps).max())


def test_a_tuned_process_predicts_held_out_points():
    data = TrainingSet.of(smooth_samples(200), NAMES)
    made = list(kriging(data, gflop=10.0))
    best = [c for c in made if c.model is not None][-1]
    poses = smooth_poses(100, seed=6)
    off = best.model(poses) - smooth_wrenches(poses)[:, 0, [1, 0, 3]]
    assert (np.sqrt((off**2).mean(axis=0)) < 0.05 * data.load_scale[1]).all()
    assert best.samples == len(data)
    assert best.training_seconds > 0.0
    assert "condition number" in best.remark


def test_the_kernel_is_tuned_on_a_subset_as_large_as_the_budget_allows_the_same_every_time():
    data = TrainingSet.of(smooth_samples(360), NAMES)
    small, large = (tuned_kernel(data, gflop, 1e-7) for gflop in (1.0, 14.0))
    assert (small[1], large[1]) == (250, len(data))
    np.testing.assert_array_equal(tuned_kernel(data, 1.0, 1e-7)[0].theta, small[0].theta)


def test_what_memory_or_budget_does_not_allow_stays_with_its_reason(data):
    def fit(count):
        return Kriging(data, count, SMOOTH_KERNEL)

    common = {"family": "K", "points": 480, "gflop_of": fit_gflop, "bytes_per_pair": 48.0, "first": 100}
    small = list(grow(fit, gflop=60.0, memory=5e6, **common))
    assert [isinstance(c, Kriging) for c in small] == [True, True, False]
    assert "GiB" in small[-1].failure
    for budget, models in ((1e-9, 1), (fit_gflop(100) + fit_gflop(200), 2)):
        dear = list(grow(fit, gflop=budget, **common))
        assert [isinstance(c, Kriging) for c in dear] == [True] * models + [False]
        assert "are left" in dear[-1].failure


def test_a_matrix_that_is_not_positive_stays_with_its_reason():
    def fit(count):
        raise np.linalg.LinAlgError("not positive definite")

    (only,) = grow(fit, family="K", points=50, gflop=1.0, gflop_of=fit_gflop, bytes_per_pair=48.0)
    assert only.model is None
    assert only.failure == "not positive definite"


def test_without_scikit_learn_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn", None)
    (only,) = peer_candidates(smooth_samples(200), gflop=1.0, families=["Kriging"])
    assert only.model is None
    assert only.failure == "Kriging needs scikit-learn: pip install casadi_contact[peers]"
