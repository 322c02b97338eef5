"""Products with JᵀJ in single precision, on many rows: near enough to exact ones, and fits end where exact ones do."""

import numpy as np
import pytest

from casadi_contact.networks.training import mlp as exactly
from casadi_contact.networks.training.arrays import NumpyArrays
from casadi_contact.networks.training.levenberg_marquardt import LevenbergMarquardt
from casadi_contact.networks.training.mlp import SINGLE_FROM, Mlp
from casadi_contact.networks.training.trunk import TrunkMlp
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten
from tests.support.regressions import smooth

ROWS = SINGLE_FROM + 700


def single(scale):
    data = smooth(ROWS)
    network = initial_network(data.inputs, data.targets, (6, 5), "algebraic", seed=1)
    return Mlp(network, data.inputs, data.targets, scale * data.weights, 0.0, NumpyArrays()), flatten(network)


def trunk(scale):
    data = smooth(ROWS)
    targets = np.column_stack([data.targets, data.targets**2])
    network = initial_network(data.inputs, targets, (6, 5), "tanh", seed=1)
    return TrunkMlp(network, data.inputs, targets, scale * np.ones_like(targets), 0.0, NumpyArrays()), flatten(network)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("kind", [single, trunk])
def test_products_are_near_those_in_double_precision(kind, scale, monkeypatch):
    mlp, parameters = kind(scale)
    mlp.accept(mlp.evaluate(parameters, solve_output=False)[0])
    v = np.random.default_rng(2).normal(size=mlp.parameter_count)
    rough = mlp.gram_product(v)
    monkeypatch.setattr(exactly, "SINGLE_FROM", 10 * ROWS)
    mlp, parameters = kind(scale)
    mlp.accept(mlp.evaluate(parameters, solve_output=False)[0])
    exact = mlp.gram_product(v)
    np.testing.assert_allclose(rough, exact, atol=1e-5 * np.abs(exact).max())
    assert not np.array_equal(rough, exact)


def test_a_network_s_own_function_is_recovered_as_in_double_precision():
    data = smooth(ROWS)
    true = initial_network(data.inputs, data.targets, (3,), "algebraic", seed=8)
    near = unflatten(flatten(true) + 0.1 * np.random.default_rng(1).normal(size=true.parameter_count), true)
    mlp = Mlp(near, data.inputs, true.value(data.inputs), np.ones(ROWS), 0.0, NumpyArrays())
    lm = LevenbergMarquardt(mlp, flatten(near), 0)
    for _ in range(300):
        lm.step()
        if lm.rms < 1e-13:
            break
    assert lm.rms < 1e-12
