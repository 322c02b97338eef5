"""The Jacobian of the residuals against torch's autograd and finite differences, and the conversions around it."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.networks.training.arrays import NumpyArrays
from casadi_contact.networks.training.mlp import Mlp
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten
from tests.support.regressions import smooth

torch = pytest.importorskip("torch", reason="these oracles need the extra torch")


@pytest.fixture(params=["algebraic", "tanh"])
def network(request):
    data = smooth()
    return initial_network(data.inputs, data.targets, (5, 4, 3), request.param, seed=3)


def mlp_of(network, data, arrays=None, chunk_rows=64):
    return Mlp(network, data.inputs, data.targets, data.weights, data.false_load, arrays or NumpyArrays(), chunk_rows)


def with_false_loads(rows):
    """Every third row must not be positive: the targets there are below zero."""
    data, rng = smooth(rows), np.random.default_rng(4)
    must_not = np.arange(rows) % 3 == 0
    targets = np.where(must_not, -data.targets, data.targets)
    return replace(data, targets=targets, false_load=np.where(must_not, rng.uniform(0.5, 30.0, rows), 0.0))


def at(mlp, parameters):
    """Make the parameters current as they are; returns the gradient."""
    parameters, _ = mlp.evaluate(parameters, solve_output=False)
    return mlp.accept(parameters)


def torch_residuals(network, data, parameters):
    a = torch.tensor((data.inputs - network.input_shift) / network.input_scale)
    start, layers = 0, list(zip(network.weights, network.biases, strict=True))
    for level, (weight, bias) in enumerate(layers):
        rows, columns = len(bias), weight.shape[1] + 1
        v = parameters[start : start + rows * columns].reshape(rows, columns)
        start += rows * columns
        a = a @ v[:, :-1].T + v[:, -1]
        if level < len(layers) - 1:
            a = torch.tanh(a) if network.activation == "tanh" else a / torch.sqrt(1 + a**2)
    y = network.output_scale * a[:, 0]
    off = torch.tensor(data.weights) * (y - torch.tensor(data.targets))
    return torch.cat([off, torch.tensor(data.false_load) * y.clip(min=0.0) ** 2]) if np.any(data.false_load) else off


def test_jacobian_is_autograd_s(network):
    data, parameters = smooth(150), flatten(network)
    mlp = mlp_of(network, data)
    at(mlp, parameters)
    oracle = torch.autograd.functional.jacobian(
        lambda p: torch_residuals(network, data, p), torch.tensor(parameters)
    ).numpy()
    np.testing.assert_allclose(mlp.residuals, torch_residuals(network, data, torch.tensor(parameters)), rtol=1e-12)
    np.testing.assert_allclose(mlp.jacobian(slice(None)), oracle, atol=1e-12 * np.abs(oracle).max())


def test_jacobian_is_that_of_finite_differences(network):
    data, parameters, h = smooth(50), flatten(network), 1e-6
    mlp = mlp_of(network, data)
    at(mlp, parameters)
    jacobian = mlp.jacobian(slice(None))
    ends = [mlp.weighted_residuals(parameters + side * h * np.eye(len(parameters))[j]) for j in range(len(parameters))
            for side in (1, -1)]  # fmt: skip
    differences = np.stack([(ends[2 * j] - ends[2 * j + 1]) / (2 * h) for j in range(len(parameters))], axis=1)
    np.testing.assert_allclose(jacobian, differences, atol=1e-7 * np.abs(jacobian).max())


def test_loss_gradient_and_gram_with_false_loads_are_those_of_two_residuals_a_row(network):
    data, parameters = with_false_loads(150), flatten(network)
    assert (network.value(data.inputs)[data.false_load > 0.0] > 0.0).any(), "false loads"
    mlp = mlp_of(network, data)
    _, loss = mlp.evaluate(parameters, solve_output=False)
    gradient = mlp.accept(parameters)
    both = torch_residuals(network, data, torch.tensor(parameters)).numpy()
    oracle = torch.autograd.functional.jacobian(
        lambda p: torch_residuals(network, data, p), torch.tensor(parameters)
    ).numpy()
    assert loss == pytest.approx(0.5 * both @ both, rel=1e-12)
    np.testing.assert_allclose(gradient, oracle.T @ both, atol=1e-11 * np.abs(gradient).max())
    gram = oracle.T @ oracle
    np.testing.assert_allclose(np.triu(mlp.gram()), np.triu(gram), atol=1e-12 * np.abs(gram).max())
    of_rows = np.hypot(*both.reshape(2, -1))
    np.testing.assert_allclose(np.abs(mlp.weighted_residuals(parameters)), of_rows, rtol=1e-12)
    np.testing.assert_allclose(np.abs(data.residuals(network)), of_rows, rtol=1e-12)


def test_products_and_gram_are_those_of_the_jacobian(network):
    data = with_false_loads(730)
    mlp = mlp_of(network, data)
    gradient = at(mlp, flatten(network))
    jacobian = mlp.jacobian(slice(None))
    rng = np.random.default_rng(0)
    v, u = rng.normal(size=mlp.parameter_count), rng.normal(size=mlp.rows)
    for got, expected in (
        (mlp.jvp(v), jacobian @ v),
        (mlp.vjp(u), jacobian.T @ u),
        (mlp.gram_product(v), jacobian.T @ (jacobian @ v)),
        (gradient, jacobian.T @ mlp.residuals),
        (mlp.gram()[np.triu_indices(len(v))], (jacobian.T @ jacobian)[np.triu_indices(len(v))]),
    ):
        np.testing.assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())


def test_gram_of_chosen_rows_scales_each(network):
    data = smooth(700)
    mlp = mlp_of(network, data)
    at(mlp, flatten(network))
    rows, scales = np.arange(3, 690, 7), np.linspace(0.5, 3.0, 99)
    chosen = mlp.jacobian(rows) * scales[:, None]
    expected = chosen.T @ chosen
    np.testing.assert_allclose(np.triu(mlp.gram(rows, scales)), np.triu(expected), atol=1e-11 * np.abs(expected).max())


def test_the_output_layer_is_the_least_squares_one(network):
    """No change of the output layer lowers the loss: the gradient by its weights vanishes."""
    data = smooth()
    mlp = mlp_of(network, data)
    before = mlp.evaluate(flatten(network), solve_output=False)[1]
    start = np.abs(mlp.accept(flatten(network))[-4:]).max()
    parameters, loss = mlp.evaluate(flatten(network))
    assert loss < before
    assert np.abs(mlp.accept(parameters)[-4:]).max() < 1e-7 * start


def test_parameters_and_networks_convert_both_ways(network):
    data = smooth()
    again = unflatten(flatten(network), network)
    np.testing.assert_array_equal(again.value(data.inputs), network.value(data.inputs))
    expected = data.weights * (network.value(data.inputs) - data.targets)
    residuals = mlp_of(network, data).weighted_residuals(flatten(network))
    np.testing.assert_allclose(residuals, expected, atol=1e-12 * np.abs(expected).max())


def test_initial_network_is_seeded_and_scaled_by_the_data():
    data = smooth()
    one, same, other = (initial_network(data.inputs, data.targets, (4,), "tanh", seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(flatten(one), flatten(same))
    assert not np.array_equal(flatten(one), flatten(other))
    standard = (data.inputs - one.input_shift) / one.input_scale
    np.testing.assert_allclose(standard.std(axis=0), 1.0)
    assert one.output_scale == pytest.approx(data.targets.std())
