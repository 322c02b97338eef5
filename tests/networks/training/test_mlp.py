"""Products with the Jacobian of the residuals: one and several outputs against finite differences and autograd."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.networks.training.mlp import Mlp, SeveralOutputsMlp
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten, widen
from tests.support.smooth_samples import smooth


def regression(outputs=1, rows=150):
    """One output, where every third row must not be positive; or several."""
    data, rng = smooth(rows), np.random.default_rng(4)
    if outputs > 1:
        targets = np.column_stack([data.targets, data.targets**2, np.sin(data.inputs).sum(axis=1)])
        return replace(data, targets=targets, weights=rng.uniform(0.2, 1.0, targets.shape))
    must_not = np.arange(rows) % 3 == 0
    false_load = np.where(must_not, rng.uniform(0.5, 30.0, rows), 0.0)
    return replace(data, targets=np.where(must_not, -data.targets, data.targets), false_load=false_load)


def mlp_of(network, data, chunk_rows=64, **options):
    kind = Mlp if network.outputs == 1 else SeveralOutputsMlp
    return kind(network, data, chunk_rows, **options)


def all_rows(mlp):
    """JᵀJ."""
    return mlp.gram(np.arange(mlp.rows), np.ones(mlp.rows))


def at(mlp, parameters):
    """Make the parameters current as they are; returns the gradient."""
    return mlp.accept(mlp.evaluate(parameters, solve_output=False)[0])


@pytest.fixture(params=[(1, "algebraic"), (1, "tanh"), (3, "algebraic"), (3, "tanh")], ids=str)
def case(request):
    outputs, activation = request.param
    data = regression(outputs)
    return initial_network(data.inputs, data.targets, (5, 4, 3), activation, seed=3), data


def test_products_gradient_and_gram_are_those_of_the_differentiated_loss(case):
    """Finite differences of the residuals r and e; J of `Mlp` may differ from them by a rotation within each row."""
    network, data = case
    mlp, parameters, h = mlp_of(network, data), flatten(network), 1e-6

    def residuals(p):
        y = unflatten(p, network).value(data.inputs)
        off = data.weights * (y - data.targets)
        return np.concatenate([off.ravel(), np.ravel(data.false_load * np.maximum(y, 0.0) ** 2)])

    steps = h * np.eye(len(parameters))
    differences = np.stack([(residuals(parameters + e) - residuals(parameters - e)) / (2 * h) for e in steps], axis=1)
    gradient = at(mlp, parameters)
    expected = differences.T @ residuals(parameters)
    np.testing.assert_allclose(gradient, expected, atol=1e-7 * np.abs(expected).max())
    gram = differences.T @ differences
    np.testing.assert_allclose(np.triu(all_rows(mlp)), np.triu(gram), atol=1e-6 * np.abs(gram).max())
    jacobian, rng = mlp.jacobian(np.arange(mlp.rows)), np.random.default_rng(0)
    v, u = rng.normal(size=len(parameters)), rng.normal(size=mlp.residuals.shape)
    rows, scales = np.arange(3, 147, 7), np.linspace(0.5, 3.0, 21)
    chosen = mlp.jacobian(rows) * np.repeat(scales, network.outputs)[:, None]
    for got, product in (
        (np.triu(mlp.gram(rows, scales)), np.triu(chosen.T @ chosen)),
        (mlp.vjp(u), jacobian.T @ u.ravel()),
        (mlp.gram_product(v), jacobian.T @ (jacobian @ v)),
        (gradient, jacobian.T @ mlp.residuals.ravel()),
        (np.triu(all_rows(mlp)), np.triu(jacobian.T @ jacobian)),
    ):
        np.testing.assert_allclose(got, product, atol=1e-11 * np.abs(product).max())


def test_the_loss_is_that_of_the_regression(case):
    network, data = case
    loss = mlp_of(network, data).evaluate(flatten(network), solve_output=False)[1]
    assert loss == pytest.approx(0.5 * np.sum(data.squares(network)), rel=1e-12)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_single_precision_is_near_double_precision(case, scale):
    network, data = case
    data = replace(data, weights=scale * data.weights, false_load=0.0)
    rough, exact = (mlp_of(network, data, single_from=rows) for rows in (0, 10**9))
    v = np.random.default_rng(2).normal(size=network.parameter_count)
    for mlp in (rough, exact):
        at(mlp, flatten(network))
    got, expected = rough.gram_product(v), exact.gram_product(v)
    np.testing.assert_allclose(got, expected, atol=1e-5 * np.abs(expected).max())
    assert not np.array_equal(got, expected)


def test_the_output_layer_is_the_least_squares_one(case):
    """No change of the output layer lowers the loss: the gradient with respect to its weights vanishes."""
    network, data = case
    mlp, width = mlp_of(network, replace(data, false_load=0.0)), 4 * network.outputs
    before = mlp.evaluate(flatten(network), solve_output=False)[1]
    start = np.abs(mlp.accept(flatten(network))[-width:]).max()
    parameters, loss = mlp.evaluate(flatten(network))
    assert loss < before
    assert np.abs(mlp.accept(parameters)[-width:]).max() < 1e-7 * start


def test_work_is_two_operations_for_each_row_and_weight():
    """An evaluation with its small least-squares problem, a gradient, a product with JᵀJ and JᵀJ itself, by hand."""
    data = smooth(100)
    mlp = mlp_of(initial_network(data.inputs, data.targets, (4,), "tanh", 0), data)
    weights = 4 * 4 + 5
    parameters, _ = mlp.evaluate(flatten(mlp.like))
    assert mlp.flop == 2 * 100 * weights + 2 * 100 * 5**2
    mlp.accept(parameters)
    assert mlp.flop == 6 * 100 * weights + 2 * 100 * 5**2
    before = mlp.flop
    mlp.gram_product(parameters)
    assert mlp.flop - before == 4 * 100 * weights
    all_rows(mlp)
    assert mlp.flop - before == 4 * 100 * weights + 100 * weights**2


def test_initial_network_is_seeded_and_scaled_by_the_data():
    data = smooth()
    one, same, other = (initial_network(data.inputs, data.targets, (4,), "tanh", seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(flatten(one), flatten(same))
    assert not np.array_equal(flatten(one), flatten(other))
    np.testing.assert_allclose(((data.inputs - one.input_shift) / one.input_scale).std(axis=0), 1.0)
    assert one.output_scale == pytest.approx(data.targets.std())


@pytest.mark.parametrize("wide", [(7, 4, 3), (5, 6, 4)])
def test_widening_keeps_the_function(case, wide):
    network, data = case
    wider = widen(network, wide, seed=0)
    assert wider.hidden == wide
    values = network.value(data.inputs)
    np.testing.assert_allclose(wider.value(data.inputs), values, atol=1e-12 * np.abs(values).max())
