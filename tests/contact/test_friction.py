"""Friction and dissipation: closed forms, derivatives of all forms against differences, and rest."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.material import FRICTION_NAMES, Friction

RUBBING = dict(zip(FRICTION_NAMES, (0.3, 0.2, 1e-3, 20.0, 2e-3), strict=True))
ON_PLANE, IN_GROOVE = [0.3, 29.8, -0.2, 0.05, 0.1, -0.2], [-49.7, 1.0, 0.3, 0.02, 0.05, 0.1]
RATES = np.array([20.0, -30.0, 12.0, 0.5, -0.2, 0.4])
MODELS = {  # scene, a pose, class, its resolution
    "elements": ("sphere_on_plane", ON_PLANE, cc.ElasticFoundation, (120, 120)),
    "rays": ("patellofemoral", IN_GROOVE, cc.PolarFoundation, cc.Rays(24, 4)),
    "cells": ("sphere_on_plane", ON_PLANE, cc.CellFoundation, cc.Cells(1.2, 0.75)),
}


@pytest.fixture(scope="module", params=MODELS)
def rubbing(request):
    """A model, by its kernel where it has one, the same in NumPy, and a pose."""
    name, pose, kind, resolution = MODELS[request.param]
    models = (kind(cc.load_scene(name, **RUBBING), resolution, compiled=compiled) for compiled in (True, False))
    return *models, np.array(pose)


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
    model, _, pose = rubbing
    still, resting = model.wrenches(pose), model.wrenches(pose, np.zeros(6))
    np.testing.assert_allclose(resting, still, rtol=1e-12, atol=1e-14 * np.abs(still).max())


def test_what_takes_no_velocity_says_so():
    for model in (cc.load_surrogate("knee"), cc.foundation("hip")):
        with pytest.raises(ValueError, match="velocit"):
            model.function(velocity=True)
    with pytest.raises(ValueError, match="velocities have"):
        cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (20, 20))(ON_PLANE, velocities=[1.0, 2.0])


def test_kernel_and_numpy_agree_with_derivatives_of_differences(rubbing):
    """By pose, velocity, all coefficients, stiffness and place; differences of elements, which meet the body one after
    the other, jump."""
    model, plain, pose = rubbing
    names = (*FRICTION_NAMES, "youngs_modulus", "fixed_ty")
    x = np.concatenate([pose, RATES, [*RUBBING.values(), 463.0, 0.0]])
    inputs, loads = ca.MX.sym("inputs", len(x)), model.load_names
    weights, order = np.cos(np.arange(len(loads))), (slice(0, 6), slice(6, 12), slice(12, None))
    of_all = [
        each.function(velocity=True, parameters=names)(*(inputs[part] for part in order)) for each in (model, plain)
    ]
    forms = ca.Function("forms", [inputs], [part for each in of_all for part in (each, ca.jacobian(each, inputs))])
    value, slope, same, same_slope = (np.asarray(part) for part in forms(x))
    np.testing.assert_allclose(value.ravel(), model(pose, velocities=RATES), rtol=1e-10)
    np.testing.assert_allclose(np.asarray(model.function(velocity=True)(pose, RATES)), value, rtol=1e-10)
    size = np.abs(slope).max(axis=0) + 100.0
    for found, expected in ((same, value), (same_slope / size, slope / size)):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    if isinstance(model, cc.ElasticFoundation):
        return
    bend = np.asarray(ca.Function("bend", [inputs], ca.hessian(ca.dot(weights, of_all[0]), inputs)[:1])(x))
    bend_size = np.abs(bend).max(axis=0) + 100.0
    for column, step in enumerate(np.diag([*[1e-5] * 12, *1e-4 * x[12:-1], 1e-5])):
        up, down = ([np.asarray(part) for part in forms(x + way)[:2]] for way in (step, -step))
        by, slopes_by = ((one - other) / (2.0 * step[column]) for one, other in zip(up, down, strict=True))
        np.testing.assert_allclose(by[:, 0] / size[column], slope[:, column] / size[column], atol=1e-6)
        found, expected = (each / bend_size[column] for each in (bend[:, column], weights @ slopes_by))
        np.testing.assert_allclose(found, expected, atol=2e-6)  # of rays they are those of the integral


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
