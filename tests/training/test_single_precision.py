"""Products with JᵀJ in single precision, on many rows: near enough to exact ones, and fits end where exact ones do."""

import numpy as np
import pytest

from casadi_contact.network import PartsRegression
from casadi_contact.network.spots import joint_root
from casadi_contact.training import mlp as exactly
from casadi_contact.training.arrays import NumpyArrays
from casadi_contact.training.levenberg_marquardt import LevenbergMarquardt
from casadi_contact.training.mlp import SINGLE_FROM, Mlp
from casadi_contact.training.parts_mlp import PartsMlp, flatten_parts
from casadi_contact.training.spots import SpotMlp
from casadi_contact.training.trunk import TrunkMlp
from casadi_contact.training.weights import flatten, initial_network, unflatten
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


def spots(scale):
    data = smooth(ROWS)
    network = initial_network(data.inputs, data.targets, (6, 5), "algebraic", seed=1, spots=2)
    target = joint_root(np, network.value(data.inputs))[0] + 0.1
    return SpotMlp(network, data.inputs, target, scale * data.weights, 0.0, NumpyArrays()), flatten(network)


def parts(scale, compiled=False):
    data = smooth(ROWS)
    networks = [initial_network(data.inputs, data.targets, (4, 4), "algebraic", seed) for seed in (1, 2)]
    roots = np.stack([network.value(data.inputs) for network in networks], axis=1)
    rng = np.random.default_rng(5)
    shares = scale * rng.uniform(0.5, 1.0, (ROWS, 2, 3))
    wanted, nothing = rng.normal(size=(ROWS, 3)), np.zeros(ROWS, bool)
    both = PartsRegression(
        *(
            "patch",
            ("a", "b"),
            (data.inputs, data.inputs),
            shares,
            wanted,
            roots,
            0.1 * np.ones((ROWS, 2)),
            nothing,
            1.0,
        )
    )
    return PartsMlp(networks, both, compiled=compiled), flatten_parts(networks)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("kind", [single, trunk, spots, parts])
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
