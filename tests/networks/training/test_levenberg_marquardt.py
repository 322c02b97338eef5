"""Levenberg-Marquardt against problems whose solution is known."""

import numpy as np
import pytest

from casadi_contact.networks.training.levenberg_marquardt import LevenbergMarquardt
from casadi_contact.networks.training.mlp import Mlp
from casadi_contact.networks.training.weights import flatten, initial_network, unflatten
from tests.support.smooth_samples import smooth


def solver(data, hidden, seed=0, like=None, activation="algebraic", accuracy=0.1, **options):
    like = like or initial_network(data.inputs, data.targets, hidden, activation, seed)
    return LevenbergMarquardt(Mlp(like, data, **options), flatten(like), seed, None, accuracy), like


def test_linear_least_squares_takes_one_step():
    data = smooth()
    lm, like = solver(data, ())
    lm.step()
    design = np.column_stack([data.inputs, np.ones(len(data.targets))]) * data.weights[:, None]
    solution = np.linalg.lstsq(design, data.weights * data.targets, rcond=None)[0]
    expected = np.sqrt(np.mean((design @ solution - data.weights * data.targets) ** 2))
    assert lm.rms == pytest.approx(expected, rel=1e-10)
    np.testing.assert_allclose(unflatten(lm.parameters, like).value(data.inputs) * data.weights, design @ solution,
                               rtol=1e-6)  # fmt: skip


@pytest.mark.parametrize("single_from", [0, 10**9])
@pytest.mark.parametrize("activation", ["algebraic", "tanh"])
def test_a_network_s_own_function_is_recovered_to_machine_precision(activation, single_from):
    data = smooth(300)
    true = initial_network(data.inputs, data.targets, (3,), activation, seed=8)
    start = unflatten(flatten(true) + 0.1 * np.random.default_rng(1).normal(size=true.parameter_count), true)
    data = type(data)("own", data.inputs, true.value(data.inputs), np.ones(300), data.validation, 0.0)
    lm, _ = solver(data, (3,), like=start, activation=activation, single_from=single_from)
    for _ in range(300):
        lm.step()
        if lm.rms < 1e-13:
            break
    assert lm.rms < 1e-12


def test_steps_solve_the_damped_normal_equations_of_all_rows():
    """With a strict accuracy the step found with a preconditioner from a subset is that of the dense equations."""
    lm, _ = solver(smooth(4000), (6, 5), accuracy=1e-14)
    assert lm.mlp.rows_to_draw < 0.5 * lm.mlp.rows
    jacobian = lm.mlp.jacobian(np.arange(4000))
    x, predicted = lm._solve(lm._precondition())
    damped = jacobian.T @ jacobian + lm.damping * lm._unit * np.eye(lm.mlp.parameter_count)
    expected = -np.linalg.solve(damped, jacobian.T @ lm.mlp.residuals)
    np.testing.assert_allclose(x, expected, atol=1e-6 * np.abs(expected).max())
    linear = lm.mlp.residuals + jacobian @ x
    assert predicted == pytest.approx(lm.loss - 0.5 * linear @ linear, rel=1e-6)


def test_rank_deficient_problems_are_solved():
    """More parameters than different rows, an input that is constant, another that is there twice."""
    data = smooth(12)
    inputs = np.tile(np.column_stack([data.inputs, np.full(12, 3.0), data.inputs[:, 0]]), (4, 1))
    repeated = type(data)("r", inputs, np.tile(data.targets, 4), np.ones(48), np.zeros(48, bool), 0.0)
    lm, _ = solver(repeated, (8, 8))
    for _ in range(100):
        lm.step()
    assert lm.rms < 1e-6


def test_a_stationary_point_is_said():
    data = smooth(50)
    constant = type(data)("c", data.inputs, np.zeros(50), data.weights, data.validation, 0.0)
    lm, _ = solver(constant, (4,))
    for _ in range(60):
        lm.step()
    assert lm.rms < 1e-10
    assert lm.exhausted
