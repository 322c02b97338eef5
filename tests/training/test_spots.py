"""Spots in training: products against finite differences, and loads of one and of two spots, found as such."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.network import Network, Regression
from casadi_contact.network.spots import joint_root
from casadi_contact.training import TrainingSettings, fit
from casadi_contact.training.arrays import NumpyArrays
from casadi_contact.training.spots import SpotMlp
from casadi_contact.training.weights import flatten
from tests.support.random_surrogates import random_network

SPOTS = 3


@pytest.fixture
def network() -> Network:
    rng = np.random.default_rng(3)
    bias = np.array([-0.4, 0.1, -0.2])
    return random_network(rng, np.zeros(3), np.ones(3), (5, 4, 3), "algebraic", np.full(SPOTS, 2.0), bias)


def of_one_scale(network):
    return replace(network, output_scale=2.0)


def data(rows=80):
    rng = np.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, (rows, 3))
    return x, np.abs(x).sum(axis=1) - 1.0, rng.uniform(0.2, 1.0, rows)


def two_spots(rows, seed=0):
    """Two balls beside each other on a plane that tilts: each bears in proportion to its overlap squared."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (rows, 2))
    overlaps = x[:, :1] * (1.0, -1.0) + 0.3 * x[:, 1:] + 0.2 * x[:, :1] ** 2
    target = joint_root(np, overlaps)[0]
    return Regression("root", x, target, np.full(rows, 100.0), rng.random(rows) < 0.2, 0.0)


def test_products_are_with_the_jacobian_of_finite_differences(network):
    like, (x, targets, weights) = of_one_scale(network), data()
    mlp = SpotMlp(like, x, targets, weights, 0.0, NumpyArrays(), 13)
    p, _ = mlp.evaluate(flatten(like))
    gradient, h = mlp.accept(p), 1e-6
    pressed = (like.value(x) > 0.0).sum(axis=1)
    assert {0, 1, 2} <= set(pressed), "rows without contact, with one spot and with several"
    ends = [[mlp.weighted_residuals(p + side * h * e) for side in (1, -1)] for e in np.eye(len(p))]
    differences = np.stack([(after - before) / (2 * h) for after, before in ends], axis=1)
    jacobian = mlp.jacobian(slice(None))
    np.testing.assert_allclose(jacobian, differences, atol=1e-7 * np.abs(jacobian).max())
    rng = np.random.default_rng(0)
    v, u = rng.normal(size=len(p)), rng.normal(size=mlp.rows)
    size = np.abs(jacobian).max() ** 2 * mlp.rows
    np.testing.assert_allclose(mlp.jvp(v), jacobian @ v, atol=1e-12 * size)
    np.testing.assert_allclose(mlp.vjp(u), jacobian.T @ u, atol=1e-12 * size)
    np.testing.assert_allclose(mlp.gram_product(v), jacobian.T @ (jacobian @ v), atol=1e-12 * size)
    np.testing.assert_allclose(np.triu(mlp.gram()), np.triu(jacobian.T @ jacobian), atol=1e-12 * size)
    np.testing.assert_allclose(gradient, jacobian.T @ mlp.residuals, atol=1e-12 * size)


def test_torch_gives_the_same_residuals_and_gradient(network):
    pytest.importorskip("torch")
    like, columns = of_one_scale(network), data()
    found = []
    for _torch in (False, True):
        arrays = NumpyArrays()
        mlp = SpotMlp(like, *columns, 0.0, arrays, 13)
        p, loss = mlp.evaluate(arrays.array(flatten(like)))
        found.append((loss, arrays.numpy(mlp.accept(p)), arrays.numpy(mlp.residuals)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12)


def test_residuals_are_those_of_the_joint_root_load(network):
    like, (x, targets, weights) = of_one_scale(network), data()
    regression = Regression("root", x, targets, weights, np.zeros(len(x), bool), 0.0, SPOTS)
    mlp = SpotMlp(like, x, targets, weights, 0.0, NumpyArrays())
    mlp.accept(mlp.evaluate(flatten(like))[0])
    np.testing.assert_allclose(mlp.residuals, regression.residuals(like), atol=1e-12)
    np.testing.assert_allclose(regression.residuals(like), weights * (joint_root(np, like.value(x))[0] - targets))


def test_a_load_of_two_spots_needs_two_roots_and_nobody_says_which_bears_how_much():
    regression = two_spots(600)
    settings = TrainingSettings(sizes=((6, 6),), max_iterations=80, restarts=0, seed=1)
    errors = [fit(replace(regression, spots=k), settings).validation_rms for k in (1, 2)]
    assert errors[1] < 0.2 * errors[0], "the bend where one spot comes and the other goes"


def test_a_fit_of_spots_goes_on_from_its_checkpoint_and_not_from_one_of_other_spots(tmp_path):
    regression, checkpoint = replace(two_spots(200), spots=2), tmp_path / "fit.npz"
    settings = TrainingSettings(sizes=((4,),), max_iterations=20, restarts=0)
    at_once = fit(regression, settings)
    fit(regression, replace(settings, max_iterations=10), checkpoint)
    continued = fit(regression, settings, checkpoint)
    np.testing.assert_array_equal(flatten(continued.network), flatten(at_once.network))
    with pytest.raises(ValueError, match="belongs to other data"):
        fit(replace(regression, spots=3), settings, checkpoint)
