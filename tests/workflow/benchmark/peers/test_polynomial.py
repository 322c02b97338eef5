"""Response surfaces recover polynomials, have exact derivatives and never pull."""

import numpy as np
import pytest

from casadi_contact.workflow.benchmark.peers.polynomial import Monomials, Polynomial, polynomials
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from tests.support.smooth_samples import NAMES, SPREAD, differences, scaled, smooth_poses, smooth_samples

STEPS = 1e-4 * SPREAD


def polynomial_wrenches(degree, seed=1):
    monomials = Monomials(degree)
    coefficients = np.random.default_rng(seed).normal(size=(len(monomials), 3)) * [10.0, 10.0, 300.0]

    def wrenches(poses):
        values = np.zeros((len(poses), 1, 6))
        values[:, 0, [1, 0, 3]] = monomials.matrix(scaled(poses)) @ coefficients
        values[:, 0, 1] -= 5000.0  # nothing pulls, so nothing is clamped
        return values

    return wrenches


def test_there_are_as_many_monomials_as_combinatorics_says():
    assert [len(Monomials(d)) for d in (2, 3, 4, 5, 6)] == [28, 84, 210, 462, 924]


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_a_polynomial_of_the_degree_is_recovered(degree):
    wrenches = polynomial_wrenches(degree)
    model = Polynomial(TrainingSet.of(smooth_samples(600, wrenches), NAMES), degree)
    poses = smooth_poses(50, seed=9)
    want = wrenches(poses)[:, 0, [1, 0, 3]]
    np.testing.assert_allclose(model(poses), want, rtol=1e-9, atol=1e-9 * np.abs(want).max())
    np.testing.assert_allclose([model.one(pose).copy() for pose in poses], model(poses), rtol=1e-12)


def test_derivatives_are_those_of_the_value():
    model = Polynomial(TrainingSet.of(smooth_samples(600), NAMES), 3)
    multipliers = np.array([1.0, -2.0, 0.1])
    for pose in smooth_poses(4, seed=3):
        jacobian = model.jacobian_one(pose).copy()
        by_steps = differences(lambda p: model.one(p).copy(), pose, STEPS)
        np.testing.assert_allclose(jacobian, by_steps, rtol=1e-6, atol=1e-7 * np.abs(jacobian).max())
        hessian = model.hessian_one(pose, multipliers)
        by_steps = differences(lambda p: multipliers @ model.jacobian_one(p), pose, STEPS)
        np.testing.assert_allclose(hessian, by_steps, rtol=1e-5, atol=1e-6 * np.abs(hessian).max())
        np.testing.assert_array_equal(hessian, hessian.T)


def test_a_pulling_force_is_clamped_with_its_slope():
    def pulling(poses):
        values = np.zeros((len(poses), 1, 6))
        values[:, 0, 1] = 100.0 * scaled(poses)[:, 1]
        values[:, 0, 0] = values[:, 0, 1]
        return values

    model = Polynomial(TrainingSet.of(smooth_samples(200, pulling), ("Fy", "Fx")), 2)
    pose = smooth_poses(1)[0]
    pose[1] = 29.9 + 0.04
    fy, fx = model.one(pose)
    assert fy == 0.0
    assert fx == pytest.approx(80.0)
    assert not model.jacobian_one(pose)[0].any()
    assert model.jacobian_one(pose)[1, 1] == pytest.approx(100.0 / SPREAD[1])


def test_a_degree_with_more_terms_than_samples_stays_as_a_failure():
    made = {c.name: c for c in polynomials(TrainingSet.of(smooth_samples(150), NAMES), gflop=60.0)}
    assert made["polynomial 3"].model is not None
    assert "condition number" in made["polynomial 3"].remark
    assert made["polynomial 4"].model is None
    assert "degree 4 has 210 terms, more than the 120 training samples" in made["polynomial 4"].failure
