"""A tracked step: spheres by their formula, dynamics that close on a made-up step."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from problems import tracked_step
from problems.ground_contact import ground_wrench
from problems.squat import Body
from tests.support.compiler import needs_compiler
from tests.support.made_up_step import made_up


def test_spheres_press_by_hertz_and_drag_against_the_sliding():
    contact = tracked_step.spheres()
    pose = np.array([0.0, 38.0, 0.0, 0.0, 0.0, 0.0])  # four spheres 4 mm deep, two of the toes 6 mm
    still = np.asarray(contact(pose, np.zeros(6)))[:, 0]
    k = 0.5 * 1e6 ** (2.0 / 3.0)
    hertz = [4.0 / 3.0 * k * np.sqrt(0.032 * k) * depth**1.5 for depth in (0.004, 0.006)]
    assert still[1] == pytest.approx(4.0 * hertz[0] + 2.0 * hertz[1], rel=0.35)  # smoothed over 3 mm
    sliding = np.asarray(contact(pose, [500.0, 0.0, 0.0, 0.0, 0.0, 0.0]))[:, 0]
    assert sliding[0] == pytest.approx(-(0.8 + 0.5 * 0.5) * still[1], rel=0.02)


@needs_compiler
def test_a_made_up_step_is_tracked_within_the_cone():
    foot = cc.CellFoundation(cc.load_scene("foot_on_ground"), Cells(14.0, 12.0, 4, 4))
    step, truth = made_up(foot)
    pose, rates = ca.MX.sym("pose", 6), ca.MX.sym("rates", 6)
    sole = ca.Function("sole", [pose, rates], [ground_wrench(foot)(pose, rates, truth)])
    leans = np.tile([-0.1, 0.2], (len(step.time_s), 1))
    found = tracked_step.track(sole, step, leans, Body(62.0, 1.7), intervals=4)
    wanted = np.array([np.interp(found.time_s, step.time_s, load) for load in step.wrench.T]).T
    assert np.sqrt(np.mean((found.wrench - wanted)[:, :2] ** 2)) < 10.0
    assert found.cone < 0.61
    np.testing.assert_allclose(found.leans, np.tile(leans[:1], (len(found.leans), 1)), atol=0.2)


def test_a_leg_that_stands_needs_the_moments_of_its_weight_and_of_the_ground():
    """Upright over a level foot: moments are forces times levers; the equations close under them, and only then."""
    body, at = Body(62.0, 1.7), np.zeros(5)
    masses, weight = body.segments[0][:2], 9806.65e-3
    ground, arm = 300.0, tracked_step.ANKLE[0]
    ankle = ground * arm - 1.2 * weight * (arm - tracked_step.CENTRE[0])  # about the ankle, the ground presses at x = 0
    hip = [0.0, (1.2 + masses.sum()) * weight - ground]
    left = tracked_step.leg(body)(at, at, at, [ankle, ankle, ankle, *hip], [0.0, ground, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(np.asarray(left).ravel(), 0.0, atol=1e-9)
