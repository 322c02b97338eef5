"""Friction and dissipation: closed forms, derivatives of all forms against differences, and rest."""

from importlib.util import find_spec

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import casadi_contact as cc
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.scenes.material import FRICTION_NAMES, Friction
from problems.studies import sliding
from tests.support.ready_poses import KNEE

RUBBING = dict(zip(FRICTION_NAMES, (0.3, 0.2, 1e-3, 20.0, 2e-3), strict=True))
ON_PLANE, IN_GROOVE = [0.3, 29.8, -0.2, 0.05, 0.1, -0.2], [-49.7, 1.0, 0.3, 0.02, 0.05, 0.1]
RATES = np.array([20.0, -30.0, 12.0, 0.5, -0.2, 0.4])
MODELS = {  # scene, a pose, class, its resolution
    "elements": ("sphere_on_plane", ON_PLANE, lambda *made, compiled: cc.ElasticFoundation(*made), (120, 120)),
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
    own = symbolic(cc.CallableModel(cc.load_scene("sphere_on_plane"), lambda poses: np.zeros((len(poses), 1, 6))))
    for model in (own, cc.foundation("hip")):
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


@pytest.mark.parametrize("share", [0.5, 0.99, 1.01])
def test_a_block_on_a_slope_creeps_below_the_cone_of_friction_and_slides_away_above_it(share):
    """Below μ_s it creeps at less than the transition velocity, where friction holds it; above it goes on faster."""
    static, dynamic, transition, gravity = 0.5, 0.4, 5.0, 9810.0
    friction = {"static_friction": static, "dynamic_friction": dynamic, "transition_velocity": transition}
    block = cc.ElasticFoundation(cc.load_scene("punch_on_plane", **friction), (4, 4))
    slope = np.arctan(share * static)

    def held(speed):
        load = block([0.0, -0.05, 0.0, 0.0, 0.0, 0.0], velocities=[speed, 0.0, 0.0, 0.0, 0.0, 0.0])
        return -load[0] / load[1]

    motion = solve_ivp(
        lambda _, v: gravity * (np.sin(slope) - np.cos(slope) * held(v[0])),
        (0.0, 1.0),
        [0.0],
        rtol=1e-8,
        method="LSODA",
    )
    assert held(transition) == pytest.approx(static, rel=1e-12)
    if share < 1.0:
        assert motion.y[0, -1] < transition
        assert held(motion.y[0, -1]) == pytest.approx(np.tan(slope), rel=5e-3)
    else:
        run = motion.y[0, -1] - np.interp(0.9, motion.t, motion.y[0])
        assert run == pytest.approx(0.1 * gravity * (np.sin(slope) - np.cos(slope) * dynamic), rel=5e-3)


def test_a_sphere_bounces_back_with_the_speed_that_dissipation_leaves():
    """m·v·dv = -F(d)·(1 + c·v)·dd, so that for any F the speeds v and e·v before and after have the same
    ∫v/(1 + c·v) dv: x - ln(1 + x) = -y - ln(1 - y) with x = c·v, y = c·e·v; e = 1 - 2/3·c·v for small ones."""
    mass, speed, x = 1e-3, 100.0, 0.3
    ball = cc.PolarFoundation(cc.load_scene("sphere_on_plane", dissipation=x / speed))

    def rate(_, state):
        load = ball([0.0, state[0], *[0.0] * 4], velocities=[0.0, state[1], *[0.0] * 4])
        return [state[1], -load[1] / mass]

    bounce = solve_ivp(rate, (0.0, 0.1), [30.0, -speed], rtol=1e-8, atol=1e-8)  # then it flies on
    y = brentq(lambda y: -y - np.log1p(-y) - (x - np.log1p(x)), 0.0, 0.9)
    assert bounce.y[1, -1] / speed == pytest.approx(y / x, rel=5e-3)


@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
def test_opensim_s_elastic_foundation_rubs_as_ours_does(tmp_path):
    """The same ball, a mesh there, on the same plane: normal forces differ by that mesh, in proportion all loads."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(subdivisions=6, radius=0.03).export(tmp_path / "ball.obj")
    model = cc.PolarFoundation(cc.load_scene("sphere_on_plane", **sliding.RUBBING))
    velocities = np.array([[0.0] * 6, [30.0, -20.0, -40.0, 0.0, 0.0, 0.0], [10.0, 20.0, 0.0, 0.5, 2.0, -0.3]])
    poses = np.tile([0.0, 29.8, 0.0, 0.0, 0.0, 0.0], (3, 1))
    theirs = sliding.by_opensim(model, poses, velocities, [tmp_path / "ball.obj"])[0]
    ours = model.wrenches(poses, velocities)[:, 0]
    np.testing.assert_allclose(theirs[:, 1], ours[:, 1], rtol=0.02)
    scale = ours[0, 1] / theirs[0, 1]
    np.testing.assert_allclose(scale * theirs[:, :3], ours[:, :3], atol=2e-3 * np.abs(ours[0, 1]))
    np.testing.assert_allclose(scale * theirs[:, 4], ours[:, 4], rtol=0.03, atol=1e-6)


def test_a_surrogate_rubs_as_its_contact_model_does():
    surrogate = cc.load_surrogate("knee", dynamic_friction=0.06, transition_velocity=2.0, dissipation=2e-4)
    poses, rates = (
        np.tile(KNEE, (8, 1)),
        np.random.default_rng(0).normal(size=(8, 6)) * [30.0, 5.0, 10.0, 0.3, 0.5, 2.0],
    )
    still, moving = (cc.PolarFoundation(surrogate.scene)(poses, velocities=way) for way in (np.zeros(6), rates))
    at_rest = surrogate(poses)
    np.testing.assert_allclose(surrogate(poses, velocities=np.zeros(6)), at_rest, rtol=1e-10, atol=1e-8)
    made = surrogate(poses, velocities=rates) - at_rest
    missed = surrogate.expected_error(poses, sliding=True) - surrogate.expected_error(poses)
    assert np.all(np.abs(made - (moving - still)) <= missed + 1e-2 * np.abs(made))
    assert np.all(np.abs(made[:, 2]) > 20.0 * missed[:, 2])
    with pytest.raises(ValueError, match="youngs_modulus"):
        surrogate.function(velocity=True, parameters=["youngs_modulus"])
    with pytest.raises(ValueError, match="radius"):
        cc.load_surrogate("knee", radius=2.0)


@pytest.mark.parametrize(
    "lift", [[0.0, 0.0], [0.0, 0.003], [0.12, 0.0], [3.0, 0.0]], ids=["on", "tilted", "light", "off"]
)
def test_the_kernel_of_a_rubbing_surrogate_has_the_derivatives_of_its_graph(lift):
    """By pose, velocity and coefficients: at rest, sticking and sliding."""
    model, inputs = cc.load_surrogate("knee", **RUBBING), ca.MX.sym("inputs", 17)
    forms = []
    for compiled in (True, False):
        given = {"velocity": True, "parameters": FRICTION_NAMES, "compiled": compiled}
        loads = model.function(**given)(*ca.vertsplit(inputs, [0, 6, 12, 17]))
        bend = ca.hessian(ca.dot(np.cos(np.arange(7)), loads), inputs)[0]
        forms.append(ca.Function("forms", [inputs], [loads, ca.jacobian(loads, inputs), bend]))
    pose = np.array(KNEE)
    pose[[1, 3]] += lift
    for speed in (0.0, 1e-2, 3.0):
        x = np.concatenate([pose, speed * RATES, list(RUBBING.values())])
        for found, expected in zip(*(form.call([x]) for form in forms), strict=True):
            largest = np.abs(expected.full()).max()
            np.testing.assert_allclose(found.full(), expected.full(), rtol=1e-10, atol=1e-10 * largest)
