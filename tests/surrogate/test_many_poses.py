"""Many poses in NumPy are evaluated as few are, and loads and root loads together as each of them alone."""

import numpy as np
import pytest

from casadi_contact.surrogate.base import map_in_chunks
from tests.support.random_surrogates import IN_PARTS, random_poses, random_surrogate, scene_called

MANY = random_poses(4500)  # more than two blocks
CASES = [("knee", "patch"), (IN_PARTS, "patch"), ("knee", "two_stage"), ("planar_knee", "patch")]


@pytest.fixture(params=CASES, ids="-".join)
def surrogate(request):
    scene, structure = request.param
    return random_surrogate(scene_called(scene), structure, seed=4)


def test_rows_do_not_know_how_many_there_are(surrogate):
    few = MANY[1990:2010]
    for method in (surrogate, surrogate.confidence_roots):
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
    if surrogate.structure != "two_stage":  # two_stage has other networks for them
        np.testing.assert_allclose(surrogate.confidence_roots(MANY), roots, rtol=1e-13, atol=1e-13)


def test_an_error_in_a_chunk_is_that_of_the_function():
    def refuses(block):
        raise ValueError(f"{len(block)} poses")

    with pytest.raises(ValueError, match="2000 poses"):
        map_in_chunks(refuses, MANY)
