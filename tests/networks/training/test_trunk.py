"""A network of several outputs in training: its products against finite differences, its fit against single ones."""

import numpy as np
import pytest

from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.arrays import NumpyArrays
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.trunk import TrunkMlp
from casadi_contact.networks.training.weights import flatten
from tests.support.random_surrogates import random_network
from tests.support.regressions import smooth

OUTPUTS = 3


@pytest.fixture(params=["algebraic", "tanh"])
def network(request) -> Network:
    rng = np.random.default_rng(3)
    return random_network(rng, np.zeros(3), np.ones(3), (5, 4, 3), request.param, np.array([1.0, 20.0, 0.3]))


def data(rows=60):
    one, rng = smooth(rows), np.random.default_rng(1)
    x = one.inputs
    targets = np.column_stack([one.targets, one.targets**2, np.sin(x).sum(axis=1)])
    return Regression("three", x, targets, rng.uniform(0.2, 1.0, targets.shape), one.validation, 0.0)


def current(network, regression):
    mlp = TrunkMlp(network, regression.inputs, regression.targets, regression.weights, 0.0, NumpyArrays(), 13)
    parameters, _ = mlp.evaluate(flatten(network), solve_output=False)
    return mlp, mlp.accept(parameters)


def test_residuals_are_those_of_the_network(network):
    regression = data()
    mlp, _ = current(network, regression)
    wanted = regression.weights * (network.value(regression.inputs) - regression.targets)
    np.testing.assert_allclose(mlp.residuals, wanted, atol=1e-12)


def test_jacobian_is_that_of_finite_differences_and_all_products_are_with_it(network):
    mlp, gradient = current(network, data())
    p, h = flatten(network), 1e-6
    ends = [[mlp.weighted_residuals(p + side * h * e).ravel() for side in (1, -1)] for e in np.eye(len(p))]
    differences = np.stack([(after - before) / (2 * h) for after, before in ends], axis=1)
    jacobian = mlp.jacobian(slice(None))
    np.testing.assert_allclose(jacobian, differences, atol=1e-7 * np.abs(jacobian).max())
    rng = np.random.default_rng(0)
    v, u = rng.normal(size=len(p)), rng.normal(size=(mlp.rows, OUTPUTS))
    size = np.abs(jacobian).max() ** 2 * mlp.rows
    np.testing.assert_allclose(mlp.jvp(v).ravel(), jacobian @ v, atol=1e-12 * size)
    np.testing.assert_allclose(mlp.vjp(u), jacobian.T @ u.ravel(), atol=1e-12 * size)
    np.testing.assert_allclose(mlp.gram_product(v), jacobian.T @ (jacobian @ v), atol=1e-12 * size)
    np.testing.assert_allclose(np.triu(mlp.gram()), np.triu(jacobian.T @ jacobian), atol=1e-12 * size)
    np.testing.assert_allclose(gradient, jacobian.T @ mlp.residuals.ravel(), atol=1e-12 * size)


def test_gradients_of_several_outputs_are_those_of_finite_differences(network):
    x, h = data().inputs, 1e-6
    _, gradient = network.value_and_gradient(x)
    differences = np.stack([(network.value(x + e) - network.value(x - e)) / (2 * h) for e in h * np.eye(3)], axis=-1)
    assert gradient.shape == (len(x), OUTPUTS, 3)
    np.testing.assert_allclose(gradient, differences, atol=1e-7 * np.abs(gradient).max())


def test_three_outputs_are_fitted_by_neurons_they_share():
    regression = data(400)
    settings = TrainingSettings(sizes=((8, 8),), max_iterations=60, restarts=0)
    found = fit(regression, settings)
    assert found.network.outputs == OUTPUTS
    weighted = regression.weights * (found.network.value(regression.inputs) - regression.targets)
    training = weighted[~regression.validation]
    assert found.rms == pytest.approx(np.sqrt((training**2).sum(axis=1).mean()))
    spread = regression.weights * (regression.targets - regression.targets.mean(axis=0))
    assert found.rms < 0.05 * np.sqrt((spread**2).sum(axis=1).mean())


def test_targets_and_weights_must_be_of_one_shape():
    regression = data()
    broken = Regression(
        "three", regression.inputs, regression.targets, regression.weights[:, 0], regression.validation, 0.0
    )
    with pytest.raises(ValueError, match=r"weights has shape \(60,\), expected \(60, 3\)"):
        fit(broken)
