"""The paper's structure, Eqs. (1)-(7): the clamp, the chain rule, its root loads and its training targets."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.samples.samples import TEST, TRAIN
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage import TwoStageSurrogate
from tests.support.agreement import close
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import invented_samples, random_poses, random_surrogate

KNEE = load_scene("knee")


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(KNEE, "two_stage", seed=2)


def test_positive_vertical_force_is_zero_before_the_second_stage(surrogate):
    """§3.5: where Eq. (1) or (2) would pull, the force is zero and the second stage sees that zero."""
    poses = random_poses(200)
    raw = surrogate.networks["Fy_med"].value(poses), surrogate.networks["Fy_lat"].value(poses)
    clamped = [np.minimum(f, 0.0) for f in raw]
    assert (raw[0] > 0.0).any()
    assert (raw[0] < 0.0).any()
    loads = dict(zip(surrogate.load_names, surrogate(poses).T, strict=True))
    np.testing.assert_array_equal(loads["Fy_med"], clamped[0])
    want = surrogate.networks["Tx"].value(np.column_stack([poses, *clamped]))
    np.testing.assert_array_equal(loads["Tx"], want)


def test_root_loads_are_signed_roots_of_the_first_stage(surrogate):
    poses = random_poses(200, seed=3)
    roots, _ = surrogate.root_loads(poses)
    for p, name in enumerate(KNEE.sensitive_loads):
        normal = -surrogate.networks[name].value(poses) / KNEE.reference_load
        clear = np.abs(normal) * KNEE.reference_load > KNEE.boundary_load
        np.testing.assert_allclose(roots[clear, p], (np.sign(normal) * np.sqrt(np.abs(normal)))[clear], rtol=3e-5)


def test_networks_that_do_not_fit_are_named(surrogate):
    with pytest.raises(ValueError, match="lacks the networks Fy_lat"):
        TwoStageSurrogate(KNEE, {name: net for name, net in surrogate.networks.items() if name != "Fy_lat"})
    with pytest.raises(ValueError, match=r"'Tx' has \(inputs, outputs\) \(6, 1\), expected \(8, 1\)"):
        TwoStageSurrogate(KNEE, {**surrogate.networks, "Tx": surrogate.networks["Fy_med"]})


def test_regressions_are_raw_loads_on_all_fitted_samples():
    drawn = invented_samples(200)
    fitted = drawn.role != TEST
    regressions = {r.name: r for r in TwoStageSurrogate.regressions(drawn)}
    assert list(regressions) == [*KNEE.load_names, "root_med", "root_lat"]
    for name in KNEE.load_names:
        regression = regressions[name]
        np.testing.assert_array_equal(regression.targets, drawn.loads([name])[fitted, 0])
        np.testing.assert_array_equal(regression.weights, 1.0)
        np.testing.assert_array_equal(regression.validation, drawn.role[fitted] != TRAIN)
        assert regression.tolerance == KNEE.tolerances[name]
    np.testing.assert_array_equal(regressions["Fy_lat"].inputs, drawn.poses[fitted])
    np.testing.assert_array_equal(regressions["Tz"].inputs[:, 6:], drawn.loads(["Fy_med", "Fy_lat"])[fitted])

    of_patch = {r.name: r for r in PatchSurrogate.regressions(drawn)}
    for name in ("root_med", "root_lat"):
        np.testing.assert_array_equal(regressions[name].targets, of_patch[name].targets)
    without = replace(drawn, gaps=np.full_like(drawn.gaps, np.nan))
    assert [r.name for r in TwoStageSurrogate.regressions(without)] == list(KNEE.load_names), "nothing confirms"


@needs_compiler
def test_a_load_that_is_asked_for_twice_is_given_twice(surrogate):
    pose, names = random_poses(1)[0], ["Tx", "Fy_med", "Tx", "Fy_med"]
    close(surrogate.function(names, compiled=True)(pose).full().ravel(), surrogate(pose, names), 10)
