"""Peers: each family is in the table, learns what it should, and what fails says why."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.samples import TEST
from problems.studies import peers, regressors
from tests.support.smooth_samples import NAMES, SPHERE, smooth_poses, smooth_samples, smooth_wrenches


def test_every_family_is_in_the_table_and_every_stopwatch_runs(monkeypatch):
    pytest.importorskip("sklearn")
    for family, method in SMALL.items():
        monkeypatch.setitem(regressors.METHODS, family, {"small": method})
    monkeypatch.setattr(peers, "NODES", 4**6)
    samples = replace(smooth_samples(200), scene=SPHERE.with_overrides(teacher=(30, 30)))
    made = list(peers.peer_candidates(samples, NAMES))
    poses = smooth_poses(4, seed=1)
    assert {c.point.family for c in made} == {*regressors.METHODS, peers.SPLINE}
    for candidate in made:
        assert candidate.model(poses).shape == (4, 3)
        assert all(stopwatch(poses) > 0.0 for stopwatch in candidate.stopwatches.values())
    assert all(c.model is not None for c in made)


def test_no_test_or_validation_sample_is_fitted():
    samples = smooth_samples(300)
    for regression in (each for target in peers.tasks(samples, NAMES).values() for each in target):
        learned = regression.inputs[~regression.validation]
        assert len(learned) == 240
        assert not (learned[:, None, :] == samples.select(role=TEST).poses).all(axis=2).any()


SMALL = {
    "polynomial": partial(regressors.polynomial, 3),
    "Gaussian process": partial(regressors.gaussian_process, 400, None),
    "sparse Gaussian process": partial(regressors.gaussian_process, 0, 100),
    "radial basis": partial(regressors.radial_basis, 400, None),
    "neighbours": partial(regressors.neighbours, 10),
    "random forest": partial(regressors.random_forest, 5),
}


@pytest.mark.parametrize("target", [peers.LOADS, peers.ROOTS])
@pytest.mark.parametrize("family", SMALL)
def test_regressors_predict_unseen_points_of_a_smooth_function(family, target):
    pytest.importorskip("sklearn")
    peer = peers.Peer(
        SPHERE, NAMES, peers.fitted(SMALL[family], peers.tasks(smooth_samples(600), NAMES)[target], near=False)
    )
    poses = smooth_poses(100, seed=6)
    want = smooth_wrenches(poses)[:, 0, [1, 0, 3]]
    off = np.sqrt(((peer(poses) - want) ** 2).mean(axis=0))
    share = {"polynomial": 0.05, "neighbours": 0.6, "random forest": 0.6}.get(family, 0.15)
    assert (off < share * want.std(axis=0)).all()
    if (function := peer.function()) is not None:
        np.testing.assert_allclose(np.asarray(function.map(100)(poses.T)).T, peer(poses), atol=1e-6)


@pytest.mark.parametrize("target", [peers.LOADS, peers.ROOTS])
def test_b_splines_go_through_the_loads_of_the_elements(target):
    scene = SPHERE.with_overrides(teacher=(30, 30))
    samples = replace(smooth_samples(200), scene=scene)
    peer = peers.Peer(scene, NAMES, peers.splines(samples, target, NAMES, nodes=4**6))
    want = cc.ElasticFoundation(scene, scene.grids["teacher"])(samples.poses)
    want = want[:, [SPHERE.load_names.index(name) for name in NAMES]]
    assert np.sqrt(np.mean((peer(samples.poses)[:, 0] - want[:, 0]) ** 2)) < 0.2 * want[:, 0].std()


@pytest.mark.parametrize(
    ("scene", "names", "want"),
    [
        ("knee", ("Fy_med", "Tx"), [[-7.0, 7.0], [0.0, -7.0]]),  # presses downwards
        ("patellofemoral", ("Fx_lat", "Tz"), [[0.0, 7.0], [7.0, -7.0]]),  # presses forwards
        ("hip", ("Fx", "Fy"), [[-7.0, 7.0], [7.0, -7.0]]),  # presses anywhere
    ],
)
def test_a_load_that_would_pull_is_clamped_to_zero(scene, names, want):
    given = np.array([[-7.0, 7.0], [7.0, -7.0]])
    peer = peers.Peer(cc.load_scene(scene), names, {peers.LOADS: regressors.Fit(lambda rows: given)})
    np.testing.assert_array_equal(peer(np.zeros((2, 6))), want)
