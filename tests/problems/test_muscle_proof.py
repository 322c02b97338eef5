"""The linear program that proves a frame infeasible: zero where a balance is known, and what is missing where not."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.optimisation import shear_free_poses
from problems import muscle_contact
from problems.muscle_contact.example import example_walk
from problems.muscle_contact.problem import RESERVE_SIZES
from problems.muscle_contact.proof import least_overload

FRAME = 1


def posed(knee, **more):
    """The problem of a walk with more of some loads, and a pose of its frame."""
    walk = example_walk(5)
    loads = {name: curve + more.get(name, 0.0) for name, curve in walk.loads.items()}
    problem = muscle_contact.build(knee, replace(walk, loads=loads))
    return problem, shear_free_poses(knee, walk.ry, walk.rz)[FRAME]


def test_a_frame_that_balances_needs_no_overload(knee):
    problem, pose = posed(knee)
    assert least_overload(problem, problem.contact_model, pose, FRAME) == pytest.approx(0.0, abs=1e-9)


def test_a_pull_that_neither_muscles_nor_contact_give_falls_to_the_reserve(knee):
    """Muscles and contact both push the knee together or hold it: nothing pulls it apart, knee_ty < -(muscles)."""
    problem, pose = posed(knee, knee_ty=-30_000.0)
    walk, capacity = problem.walk, problem.capacity
    all_pull = (walk.arms["knee_ty"] * (capacity.active_n + capacity.passive_n))[FRAME].sum()
    missing = all_pull - walk.loads["knee_ty"][FRAME]
    assert missing > 1e4
    least = least_overload(problem, problem.contact_model, pose, FRAME)
    assert least >= missing / RESERVE_SIZES["knee_ty"] * (1.0 - 1e-9)


def test_the_bound_is_below_what_the_optimiser_leaves_to_reserves(knee):
    """600 N·m more than muscles can extend: the linear program's minimum of the largest overload, over all balances."""
    problem, _ = posed(knee, knee_flexion=600.0)
    result = muscle_contact.solve(problem)
    assert result.overloaded.all()
    shares = [np.abs(curve[FRAME]) / RESERVE_SIZES[name] for name, curve in result.reserves.items()]
    least = least_overload(problem, problem.contact_model, result.poses[FRAME], FRAME)
    assert 1.0 < least <= max(shares) * (1.0 + 1e-6)
