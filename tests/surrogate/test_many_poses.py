"""Many poses in NumPy are evaluated as few are, and loads and root loads together as each of them alone."""

import numpy as np
import pytest
from scipy.cluster.vq import kmeans2

from casadi_contact.surrogate.arrays import in_blocks
from casadi_contact.surrogate.cubic_logistic import cubic_terms, logistic_coefficients
from casadi_contact.surrogate.gaussian_kernels import spread_centres
from tests.support.random_surrogates import IN_PARTS, random_poses, random_surrogate, scene_called

MANY = random_poses(4500)  # more than two blocks
CASES = [("knee", "patch"), (IN_PARTS, "patch"), ("knee", "two_stage"), ("planar_knee", "patch")]


@pytest.fixture(params=CASES, ids="-".join)
def surrogate(request):
    scene, structure = request.param
    return random_surrogate(scene_called(scene), structure, seed=4)


def test_rows_do_not_know_how_many_there_are(surrogate):
    few = MANY[1990:2010]
    for method in (surrogate, surrogate.trust_roots):
        np.testing.assert_allclose(method(MANY)[1990:2010], method(few), rtol=1e-12, atol=1e-10)
    for method in (surrogate.jacobian, surrogate.root_loads):
        for whole, part in zip(method(MANY), method(few), strict=True):
            np.testing.assert_allclose(whole[1990:2010], part, rtol=1e-12, atol=1e-9)


def test_together_they_are_what_each_alone_is(surrogate):
    loads, slopes, roots, root_slopes = surrogate.jacobian_and_roots(MANY)
    for together, alone in zip((loads, slopes), surrogate.jacobian(MANY), strict=True):
        np.testing.assert_array_equal(together, alone)
    for together, alone in zip((roots, root_slopes), surrogate.root_loads(MANY), strict=True):
        np.testing.assert_array_equal(together, alone)
    if surrogate.trust_claims(MANY[:1]) is None:  # two_stage has other networks for them
        np.testing.assert_allclose(surrogate.trust_roots(MANY), roots, rtol=1e-13, atol=1e-13)


def test_an_error_in_a_block_is_that_of_the_function():
    def refuses(block):
        raise ValueError(f"{len(block)} poses")

    with pytest.raises(ValueError, match="2000 poses"):
        in_blocks(refuses, MANY)


def test_centres_are_those_of_k_means_plus_plus():
    points = np.random.default_rng(3).standard_normal((700, 3))
    centres, _ = kmeans2(points, 40, iter=20, minit="++", rng=np.random.default_rng(0))
    np.testing.assert_allclose(spread_centres(points, 40), centres, rtol=1e-12)


def test_odds_are_the_likeliest():
    """At the greatest likelihood residuals are orthogonal to every term but for the ridge: both kinds as likely."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((3000, 2))
    kept = x[:, 0] + 0.5 * x[:, 1] ** 2 + 0.3 * rng.standard_normal(3000) < 1.0
    terms = cubic_terms(x)
    coefficients = logistic_coefficients(terms, kept)
    chance = 1.0 / (1.0 + np.exp(-terms @ coefficients))
    weight = np.where(kept, 0.5 / kept.sum(), 0.5 / (~kept).sum())
    left = terms.T @ (weight * (kept - chance)) - 1e-3 * np.r_[0.0, coefficients[1:]]
    np.testing.assert_allclose(left, 0.0, atol=1e-6)
