"""What balances inversely stays balanced forward; energy, exact Jacobian, and what muscles do."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.muscle_contact import MuscleContact
from problems import muscle_driven
from problems.muscle_driven import MOVING, Leg
from problems.walks import example_walk


@pytest.fixture(scope="module")
def inverse():
    problem = MuscleContact(cc.load_surrogate("knee"), example_walk(frames=51))
    return problem, problem.solve()


@pytest.fixture(scope="module")
def driven(inverse):
    return muscle_driven.build(inverse[0].contact_model, *inverse)


@pytest.fixture(scope="module")
def motion(inverse, driven):
    return muscle_driven.simulate(driven, inverse[0].walk.time_s)


def test_activations_of_the_inverse_solution_drive_the_walk_they_came_from(inverse, motion):
    problem, solved = inverse
    off = problem.contact_model(motion.poses)[:, :2] - solved.loads[:, :2]
    assert (np.abs(off).max(axis=0) < 0.05 * np.abs(solved.loads[:, :2]).max(axis=0)).all()
    assert np.abs(motion.poses[:, 5] - problem.walk.rz).max() < np.radians(1.0)
    np.testing.assert_allclose(motion.poses[:, [0, 2, 4]], solved.poses[:, [0, 2, 4]], atol=1e-9)


def test_in_every_frame_of_the_inverse_solution_only_the_walks_own_acceleration_is_left(inverse):
    problem, solved = inverse
    walk, leg = problem.walk, Leg(damping=(0.0, 0.0, 0.0))
    undamped = muscle_driven.build(problem.contact_model, problem, solved, leg)
    flexion = muscle_driven.CubicSpline(walk.time_s, walk.rz)
    for frame in range(0, 51, 10):
        at = walk.time_s[frame]
        rates = np.asarray(undamped.rate([*solved.poses[frame, MOVING], 0.0, 0.0, flexion(at, 1)], at))[:, 0]
        left = np.array(leg.inertia) * (rates[3:] - [0.0, 0.0, flexion(at, 2)])
        np.testing.assert_allclose(left / [1.0, 25.0, 25.0], 0.0, atol=0.5)


def test_work_becomes_kinetic_energy_or_is_damped(inverse, driven, motion):
    assert np.abs(motion.work[:, 0]).max() > 1e3
    assert motion.energy_lost(Leg()) < 1e-4
    assert np.diff(motion.work[:, 3]).max() <= 0.0
    coarse = muscle_driven.simulate(driven, inverse[0].walk.time_s, tolerance=1e-3)
    assert coarse.energy_lost(Leg()) > motion.energy_lost(Leg())


def test_the_jacobian_of_the_motion_is_exact(inverse, driven):
    x, t = ca.MX.sym("x", 6), ca.MX.sym("t")
    jacobian = ca.Function("jacobian", [x, t], [ca.jacobian(driven.rate(x, t), x)])
    at = inverse[0].walk.time_s[12] + 0.003
    state = np.array([*inverse[1].poses[12, MOVING], 0.4, 0.02, -0.3])
    exact, differenced = np.asarray(jacobian(state, at)), np.empty((6, 6))
    for k, step in enumerate([1e-5, 1e-7, 1e-6, 1e-3, 1e-3, 1e-3]):
        ends = [np.asarray(driven.rate(state + side * step * np.eye(6)[k], at))[:, 0] for side in (-2, -1, 1, 2)]
        differenced[:, k] = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
    np.testing.assert_allclose(exact, differenced, rtol=1e-5, atol=1e-6 * np.abs(exact).max())


def test_frames_that_muscles_alone_do_not_balance_are_refused(inverse):
    problem, solved = inverse
    outcome = solved.outcome.copy()
    outcome[3] = None
    with pytest.raises(ValueError, match="50 of 51"):
        muscle_driven.build(problem.contact_model, problem, replace(solved, outcome=outcome))
