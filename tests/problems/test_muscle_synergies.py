"""Muscles that few synergies drive: activations of that rank, balance as before, and what is refused."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.muscle_walk import example_walk
from problems import muscle_contact
from problems.muscle_contact.problem import LEAST_SQUARES
from problems.muscle_contact.synergies import driven_by_synergies, factored


@pytest.fixture(scope="module")
def problem():
    walk = example_walk(frames=31)
    return muscle_contact.build(cc.load_surrogate("knee"), walk, **LEAST_SQUARES)


def cost(result):
    return float((result.activations**2).sum())


def test_fewer_synergies_balance_the_same_loads_at_a_higher_cost(problem):
    results = [muscle_contact.solve(problem)]
    for count in (5, 3):
        result = muscle_contact.solve(driven_by_synergies(problem, count))
        assert result.converged.all(), result.reason
        sizes = np.linalg.svd(result.activations, compute_uv=False)
        assert sizes[count] < 1e-5 * sizes[0], "activations are of that rank"
        assert (result.activations > 0.0).all()
        results.append(result)
    assert cost(results[0]) < cost(results[1]) < cost(results[2])


def test_a_product_of_non_negative_factors_is_factored_again():
    rng = np.random.default_rng(0)
    vectors, commands = rng.random((6, 2)) * (rng.random((6, 2)) > 0.4), rng.random((2, 30))
    found, by = factored(vectors @ commands, 2)
    assert (found >= 0.0).all()
    assert (by >= 0.0).all()
    np.testing.assert_allclose(found.sum(axis=0), 1.0)
    np.testing.assert_allclose(found @ by, vectors @ commands, atol=1e-6)


@pytest.mark.parametrize("count", [0, 13])
def test_a_number_that_drives_nothing_or_says_nothing_is_refused(problem, count):
    with pytest.raises(ValueError, match=f"got {count} synergies, expected 1 to 12"):
        driven_by_synergies(problem, count)
