"""The linear program that proves a frame infeasible: zero where a balance is known, and what is missing where not."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.optimisation.muscle_walk import example_walk
from problems import muscle_contact
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


class Lifted:
    """A knee of which neither side touches."""

    def __init__(self, scene):
        self.scene = scene

    def wrenches(self, poses):
        return np.zeros((len(poses), 2, 6))


def test_a_side_without_load_pushes_straight_up_on_the_femur_below_its_anchor(knee):
    """At x of the moving origin, so that it does not flex the knee, however far forward the femur stands: loads that
    such forces of 20 kN and 10 kN balance, with muscles at rest, need no overload."""
    _, pose = posed(knee)
    pose[[0, 4]] = 15.0, 0.0
    walk = example_walk(5)
    capacity = muscle_contact.build(knee, walk).capacity
    forces_n = np.array([20_000.0, 10_000.0])
    lever_m = 1e-3 * (knee.scene.anchors_mm[:, 2] - pose[2])
    upright = {"knee_ty": forces_n.sum(), "knee_adduction": -forces_n @ lever_m, "knee_flexion": 0.0}
    passive = {name: (walk.arms[name] * capacity.passive_n).sum(axis=1) for name in upright}
    problem, _ = posed(knee, **{name: upright[name] + passive[name] - walk.loads[name] for name in upright})
    assert least_overload(problem, Lifted(knee.scene), pose, FRAME) == pytest.approx(0.0, abs=1e-6)


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
