"""Friction and dissipation: closed forms, derivatives of all forms against differences, and rest."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.material import FRICTION_NAMES, Friction

RUBBING = dict(zip(FRICTION_NAMES, (0.3, 0.2, 1e-3, 20.0, 2e-3), strict=True))
POSE = np.array([0.3, 29.8, -0.2, 0.05, 0.1, -0.2])
RATES = np.array([20.0, -30.0, 12.0, 0.5, -0.2, 0.4])
MODELS = {
    "elements": lambda scene: cc.ElasticFoundation(scene, (120, 120)),
    "rays": lambda scene: cc.PolarFoundation(scene, cc.Rays(16, 4)),
    "rays in NumPy": lambda scene: cc.PolarFoundation(scene, cc.Rays(16, 4), compiled=False),
    "cells": cc.CellFoundation,
}


@pytest.fixture(scope="module", params=MODELS)
def rubbing(request):
    return MODELS[request.param](cc.load_scene("sphere_on_plane", **RUBBING))


def test_a_scene_without_friction_is_as_it_was_and_names_a_bad_coefficient():
    scene = cc.load_scene("sphere_on_plane")
    assert scene.friction == Friction()
    rough = scene.with_overrides(dynamic_friction=0.2)
    assert rough.friction == Friction(0.2, 0.2)
    assert rough.digest == scene.digest
    for wrong in ({"dissipation": -1.0}, {"transition_velocity": 0.0}, {"static_friction": "much"}):
        with pytest.raises(ValueError, match=f"friction.{next(iter(wrong))} = "):
            scene.with_overrides(**wrong)


def test_at_rest_loads_are_those_without_velocity(rubbing):
    still, resting = rubbing.wrenches(POSE), rubbing.wrenches(POSE, np.zeros(6))
    np.testing.assert_allclose(resting, still, rtol=1e-12, atol=1e-11 * np.abs(still).max())


def test_what_takes_no_velocity_says_so():
    for model in (cc.load_surrogate("knee"), cc.foundation("hip")):
        with pytest.raises(ValueError, match="velocit"):
            model.function(velocity=True)
    with pytest.raises(ValueError, match="velocities have"):
        cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20))(POSE, velocities=[1.0, 2.0])


LOADS = ["Fx", "Fy", "Tz"]


def test_functions_and_arrays_agree_with_derivatives_of_differences(rubbing):
    names, given = ("dissipation", "static_friction", "youngs_modulus", "fixed_ty"), np.array([2e-3, 0.3, 463.0, 0.0])
    function = rubbing.function(LOADS, velocity=True, parameters=names)
    plain, expected = rubbing.function(LOADS, velocity=True), rubbing(POSE, LOADS, RATES)
    for found in (function(POSE, RATES, given), plain(POSE, RATES)):
        np.testing.assert_allclose(np.asarray(found).ravel(), expected, rtol=1e-10)
    inputs = ca.MX.sym("inputs", 16)
    loads = function(inputs[:6], inputs[6:12], inputs[12:])
    slopes = ca.Function("slopes", [inputs], [loads, ca.jacobian(loads, inputs)])
    x = np.concatenate([POSE, RATES, given])
    steps = 1e-5 * np.maximum(np.abs(x), [*[1.0] * 12, *[1e-3] * 4])
    plus, minus = (
        np.stack([np.asarray(slopes(x + sign * step)[0]).ravel() for step in np.diag(steps)], 1) for sign in (1, -1)
    )
    differences, slope = (plus - minus) / (2.0 * steps), np.asarray(slopes(x)[1])
    scale = np.abs(differences).max(axis=0) + 1.0
    jumps = 3e-3 if isinstance(rubbing, cc.ElasticFoundation) else 1e-5  # elements meet the body one after the other
    np.testing.assert_allclose(slope / scale, differences / scale, atol=jumps)


def test_a_sphere_that_slides_is_held_back_by_the_dynamic_share_of_its_force():
    scene = cc.load_scene("sphere_on_plane", dynamic_friction=0.2, transition_velocity=1.0)
    load = cc.PolarFoundation(scene)([0.0, 29.8, 0.0, 0.0, 0.0, 0.0], velocities=[30.0, 0.0, -40.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(load[[0, 2]], 0.2 * -load[1] * np.array([0.6, -0.8]), rtol=1e-12)


def test_a_sphere_that_spins_feels_the_torque_of_its_pressures():
    """μ∫p r dA; for small depths (8/15)·μ·N·a, a² = 2Rd."""
    scene = cc.load_scene("sphere_on_plane", dynamic_friction=0.2, transition_velocity=1e-3)
    load = cc.PolarFoundation(scene, cc.Rays(16, 8))([0.0, 29.8, 0.0, 0.0, 0.0, 0.0], velocities=np.eye(6)[4])
    r = np.linspace(0.0, np.sqrt(30.0**2 - 29.8**2), 20001)
    depth = np.sqrt(30.0**2 - r * r) - 29.8
    ratio = np.trapezoid(depth * r * r, r) / np.trapezoid(depth * r, r)
    np.testing.assert_allclose(load[4], 0.2 * -load[1] * ratio, rtol=5e-3)
