"""Weights of samples multiply what residuals of theirs count, in every structure."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.samples.samples import TEST
from casadi_contact.surrogate.load import STRUCTURES
from tests.support.smooth_samples import smooth_samples


@pytest.mark.parametrize("structure", ["patch", "two_stage"])
def test_residuals_are_multiplied_by_the_weights_of_their_samples(structure):
    samples = smooth_samples(60)
    samples.wrenches[7] = 0.0  # lifted off
    light = replace(samples, weight=np.full(60, 0.25))
    pairs = zip(*(STRUCTURES[structure].regressions(part) for part in (samples, light)), strict=True)
    for plain, weighted in pairs:
        np.testing.assert_allclose(weighted.weights, 0.25 * plain.weights)
        np.testing.assert_allclose(weighted.false_load, 0.25 * np.asarray(plain.false_load))
        np.testing.assert_array_equal(weighted.targets, plain.targets)
    of_rows = replace(samples, weight=np.linspace(1.0, 2.0, 60))
    (first, *_), (other, *_) = (STRUCTURES[structure].regressions(part) for part in (samples, of_rows))
    np.testing.assert_allclose(other.weights / first.weights, of_rows.weight[samples.role != TEST])
