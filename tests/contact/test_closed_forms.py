"""Elements, polar quadrature and cells against forces in closed form, and what no ball on a plane may do."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.polar.lines import Rays
from tests.support.ready_poses import CASES, at

MODELS = {  # made of a scene, scenes that it covers, relative error of the force
    "elements": (lambda scene: cc.ElasticFoundation(scene, (400, 400)), ("sphere", "cylinder"), 1e-3),
    "polar": (lambda scene: cc.PolarFoundation(scene, Rays(12, 3), compiled=False), ("sphere",), 1e-3),
    "cells": (lambda scene: cc.CellFoundation(scene, Cells(0.6, 0.6), compiled=False), ("sphere_on", "cylinder"), 1e-2),
}
FORCES = [(kind, *case) for kind, (_, covered, _) in MODELS.items() for case in CASES if case[0].startswith(covered)]


@pytest.fixture(scope="module", params=MODELS)
def ball(request):
    """A ball of 30 mm on a plane."""
    return MODELS[request.param][0](cc.load_scene("sphere_on_plane"))


@pytest.mark.parametrize(("kind", "name", "overrides", "overlap", "force"), FORCES)
def test_forces_are_those_in_closed_form(kind, name, overrides, overlap, force):
    made, _, tolerance = MODELS[kind]
    scene = cc.load_scene(name, **overrides)
    wrench = made(scene).wrenches(at(scene.geometry["radius"] - overlap))[0, 0]
    assert wrench[1] == pytest.approx(-force, rel=tolerance)
    np.testing.assert_allclose(wrench[[0, 2, 3, 4, 5]], 0.0, atol=1e-6 * force)


def test_turning_a_ball_about_its_centre_changes_nothing(ball):
    still, turned = ball.wrenches(np.vstack([at(29.8, tx=1.0), at(29.8, tx=1.0, rx=0.4, ry=-1.1, rz=2.0)]))
    np.testing.assert_allclose(turned, still, rtol=1e-9, atol=1e-6)


def test_no_overlap_gives_exactly_zero_and_the_distance(ball):
    poses = np.vstack([at(30.25), at(30.03)])
    assert not ball.wrenches(poses).any()
    assert not ball.jacobian(poses)[1].any()
    np.testing.assert_allclose(ball.gaps(poses)[:, 0], [0.25, 0.03], atol=2e-4)
    np.testing.assert_allclose(ball.root_loads(poses)[1][:, 0, 1], -ball.scene.gap_slope, rtol=1e-3)


@pytest.mark.parametrize(
    ("kind", "name", "pose", "off"),
    [
        ("elements", "sphere_in_dish", [2.0, 30.0, 1.0, 0.0, 0.0, 0.0], 1e-9),
        ("polar", "sphere_in_dish", [2.0, 30.0, 1.0, 0.0, 0.0, 0.0], 1e-4),
        ("cells", "glenohumeral", [1.0, -0.5, -23.85, 0.1, 0.2, 0.3], 3e-5),
    ],
)
def test_the_resultant_in_a_spherical_hollow_passes_through_its_centre(kind, name, pose, off):
    model = MODELS[kind][0](cc.load_scene(name))
    g = model.scene.geometry
    centre = g["cup_centre"] if "cup_centre" in g else [0.0, g["dish_radius"], 0.0]
    force, torque = model.wrenches(pose)[0].reshape(2, 3)
    assert np.linalg.norm(force) > 100.0
    assert np.linalg.norm(torque - np.cross(centre, force)) < off * np.linalg.norm(force) * np.linalg.norm(pose[:3])


@pytest.mark.parametrize("kind", MODELS)
def test_deep_poses_stay_finite_under_the_logarithmic_law(kind):
    model = MODELS[kind][0](cc.load_scene("sphere_on_plane", law="log"))
    forces = -model(np.vstack([at(30.0 - depth) for depth in (7.0, 7.9, 8.5, 12.0)]))[:, 1]
    assert np.isfinite(forces).all()
    assert (np.diff(forces) > 0.0).all()
