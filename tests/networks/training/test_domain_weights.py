"""Residuals that count for more in some of the samples' domains."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.weights import initial_network

ROWS = 600
DOMAIN = np.repeat(np.array([1, 3, 4], dtype=np.uint8), ROWS // 3)
RANDOM = np.random.default_rng(5)
INPUTS = RANDOM.uniform(-1.0, 1.0, (ROWS, 2))
ROUGH = np.sin(3.0 * INPUTS[:, 0]) * np.cos(2.0 * INPUTS[:, 1])


def regression(**columns):
    alone = Regression("root", INPUTS, ROUGH, np.ones(ROWS), np.zeros(ROWS, bool), 0.0, domain=DOMAIN)
    return replace(alone, **columns)


def by_domain(residuals):
    """Sum of squares of each domain's rows."""
    return np.sum(residuals.reshape(3, -1) ** 2, axis=1)


@pytest.mark.parametrize("outputs", [1, 2])
def test_residuals_are_multiplied_and_their_mean_square_is_kept(outputs):
    columns = {} if outputs == 1 else {"targets": np.stack([ROUGH, ROUGH], 1), "weights": np.ones((ROWS, 2))}
    before = regression(false_load=0.5 if outputs == 1 else 0.0, **columns)
    after = before.weighted({1: 4.0, 3: 2.0})
    network = initial_network(INPUTS, before.targets, (4,), "tanh", 0)
    ratio = by_domain(after.residuals(network)) / by_domain(before.residuals(network))
    np.testing.assert_allclose(ratio, 3.0 * np.array([16.0, 4.0, 1.0]) / 21.0)


def test_nothing_weighted_is_nothing_changed():
    own = regression(domain=None)
    assert own.weighted({}) is own


def test_rows_of_no_domain_cannot_be_weighted():
    with pytest.raises(ValueError, match="belong to no domain, expected samples"):
        regression(domain=None).weighted({1: 2.0})


def test_a_small_network_is_more_accurate_where_rows_count_for_more():
    """Too few neurons for all rows: what one domain gains others lose."""
    settings = TrainingSettings(sizes=((3,),), max_iterations=150, restarts=0)
    apart = regression(targets=np.where(DOMAIN == 1, 1.0, -1.0) * ROUGH)
    even, weighted = (by_domain(apart.residuals(fit(r, settings).network)) for r in (apart, apart.weighted({1: 5.0})))
    assert weighted[0] < 0.5 * even[0]
    assert weighted[1:].sum() > even[1:].sum()
