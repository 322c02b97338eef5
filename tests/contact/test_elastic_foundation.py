"""Elastic foundations against closed forms, symmetries and invariance, of balls, punches, knees, hips, patellas."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.elements.foundation import pressed_elements
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.scenes.scene import Scene
from tests.support.ready_poses import CASES, at, in_cup, pole, walking

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


@pytest.mark.parametrize(("kind", "off"), [("elements", 1e-9), ("polar", 1e-4)])
def test_the_resultant_in_a_spherical_hollow_passes_through_its_centre(kind, off):
    model, pose = MODELS[kind][0](cc.load_scene("sphere_in_dish")), [2.0, 30.0, 1.0, 0.0, 0.0, 0.0]
    centre = [0.0, model.scene.geometry["dish_radius"], 0.0]
    force, torque = model.wrenches(pose)[0].reshape(2, 3)
    assert np.linalg.norm(force) > 100.0
    assert np.linalg.norm(torque - np.cross(centre, force)) < off * np.linalg.norm(force) * np.linalg.norm(pose[:3])


@pytest.mark.parametrize("kind", MODELS)
def test_deep_poses_stay_finite_under_the_logarithmic_law(kind):
    model = MODELS[kind][0](cc.load_scene("sphere_on_plane", law="log"))
    forces = -model(np.vstack([at(30.0 - depth) for depth in (7.0, 7.9, 8.5, 12.0)]))[:, 1]
    assert np.isfinite(forces).all()
    assert (np.diff(forces) > 0.0).all()


def test_force_errors_fall_as_the_square_of_the_element_size():
    """A quadrature of a contact with a free edge has a ragged error: compare its RMS over many positions."""
    scene = cc.load_scene("sphere_on_plane")
    rng = np.random.default_rng(0)
    poses = np.repeat(at(29.8), 60, axis=0)
    poses[:, [0, 2]] = rng.uniform(-0.5, 0.5, (60, 2))
    grids = np.array([40, 80, 160, 320])
    errors = [np.sqrt(np.mean((cc.ElasticFoundation(scene, (n, n))(poses)[:, 1] + 1006.4840) ** 2)) for n in grids]
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    assert 1.7 < order < 3.0


@pytest.mark.parametrize("law", ["linear", "log"])
def test_flat_punch_is_exact_on_any_grid(law):
    scene = cc.load_scene("punch_on_plane", law=law, area=77.0)
    K, h, d = 267.5728 * 8.0, 8.0, 0.3
    expected = 77.0 * (K * d / h if law == "linear" else -K * np.log(1 - d / h))
    loads = cc.ElasticFoundation(scene, grid=(3, 5))(at(-d))[0]
    assert loads[1] == pytest.approx(-expected, rel=1e-6)
    np.testing.assert_allclose(loads[[0, 2, 3, 4, 5]], 0.0, atol=1e-9)


def knee_poses(n, seed=0):
    """Poses over the walking range, from lightly lifted to 0.3 mm deep."""
    scene, (poses, targets) = cc.load_scene("knee"), walking(n, seed)
    settled, report = cc.settle(cc.ElasticFoundation(scene), poses, ("ty", "rx"), targets)
    assert report.converged.all()
    settled[::5, 3] += 0.02
    return scene, settled


def test_a_mirrored_pose_on_a_mirrored_knee_mirrors_the_loads():
    text = cc.load_scene("knee").to_toml()
    left, right = (
        cc.ElasticFoundation(
            Scene.from_toml(
                text.replace("[geometry]", f"[geometry]\n{side} = {{ frontal_radius = 21.0, plateau_width = 30.0 }}")
            )
        )
        for side in ("med", "lat")
    )
    _, poses = knee_poses(20)
    mirror = np.array([1, 1, -1, -1, -1, 1])  # z -> -z: tz, rx and ry change sign
    wrenches, mirrored = left.wrenches(poses), right.wrenches(poses * mirror)
    np.testing.assert_allclose(mirrored[:, ::-1], wrenches * [1, 1, -1, -1, -1, 1], atol=1e-6)


def test_root_loads_are_continuous_through_liftoff_with_their_slopes():
    scene, _ = knee_poses(1)
    model = cc.ElasticFoundation(scene, (320, 160))
    ty = np.linspace(27.2, 27.8, 121)
    poses = np.repeat(at(0.0, rz=-0.6), len(ty), axis=0)
    poses[:, 1] = ty
    s, slope = model.root_loads(poses)
    assert s[0, 0] > 0 > s[-1, 0]
    assert np.all(np.diff(s[:, 0]) < 0)
    loaded = s[:, 0] > 0.1
    np.testing.assert_allclose(slope[loaded, 0, 1], np.gradient(s[:, 0], ty)[loaded], rtol=0.03)
    assert np.all(slope[s[:, 0] < 0, 0, 1] < -0.9 * scene.gap_slope)


def test_contact_at_the_edge_of_the_elements_is_seen():
    scene = cc.load_scene("sphere_on_plane")
    poses = np.vstack([at(29.9), at(29.9, tx=11.9), at(30.1, tx=12.0), at(29.9, tz=-11.95)])
    model = cc.ElasticFoundation(scene)
    assert model.at_edge(poses)[:, 0].tolist() == [False, True, False, True]


def test_the_load_at_an_edge_is_that_within_a_millimetre_of_it():
    """Deep in a plane of ±12 mm, a ball that comes to the edge has an ever larger share of its load there."""
    model = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), (230, 230))
    poses = np.vstack([at(29.9, tx=x) for x in (8.0, 10.0, 12.0, 14.0, 20.0)])
    share = model.edge_share(poses)[:, 0]
    assert share[0] == share[-1] == 0.0 < share[1] < share[2] < 0.99 < share[3]
    points, forces = pressed_elements(model, poses[2])
    assert share[2] == pytest.approx(forces[points[:, 0] > 12.0 - 1.05].sum() / forces.sum(), rel=0.02)
    np.testing.assert_allclose(model.edge_wrenches(poses)[3], model.wrenches(poses)[3], atol=1e-9)


def test_a_users_own_callable_is_a_contact_model():
    scene = cc.load_scene("sphere_on_plane")
    reference = cc.ElasticFoundation(scene)
    model = cc.CallableModel(scene, reference.wrenches)
    poses = at(29.83, tx=0.2)
    np.testing.assert_allclose(model(poses), reference(poses))
    np.testing.assert_allclose(model.jacobian(poses)[1], reference.jacobian(poses)[1], rtol=1e-2, atol=2.0)
    settled, report = cc.settle(model, at(33.0), ("ty",), {"Fy": -500.0})
    assert report.converged.all()
    assert reference(settled)[0, 1] == pytest.approx(-500.0, abs=1e-3)
    with pytest.raises(ValueError, match=r"returned wrenches of shape \(1, 6\), expected \(1, 1, 6\)"):
        cc.CallableModel(scene, lambda p: np.zeros((len(p), 6)))(poses)


def test_depths_stay_finite_on_the_back_of_a_body_where_its_distance_jumps():
    """Beyond its last arc a condyle's distance function jumps; rays that end there once gave 1e42 N, pulling."""
    scene = cc.load_scene("knee")
    unit = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 6))
    poses = np.array([0.0, 26.0, 0.0, 0.0, 0.0, -2.2]) + np.array([25.0, 8.0, 3.0, 0.4, 0.4, 0.5]) * unit
    normal = -cc.ElasticFoundation(scene, (40, 30))(poses)[:, :2]
    assert (normal > 0.0).sum() > 500
    assert normal.min() >= 0.0
    assert normal.max() < 1e7


@pytest.fixture(scope="module")
def hip():
    return cc.ElasticFoundation(cc.load_scene("hip"), (60, 60))


def test_a_deep_cup_gives_the_integral_over_its_cap(hip):
    """F = 2πR² ∫ p(d(θ)) cos θ sin θ dθ, with d(θ) the ball's reach beyond the cup along the ray at θ."""
    g, material = hip.scene.geometry, hip.scene.material
    ball, cup, e = g["ball_radius"], g["cup_radius"], 0.46

    def depth(theta):
        return max(e * np.cos(theta) + np.sqrt(ball**2 - (e * np.sin(theta)) ** 2) - cup, 0.0)

    nu = material.poissons_ratio
    modulus = (1 - nu) * material.youngs_modulus / ((1 + nu) * (1 - 2 * nu))
    area = 2.0 * np.pi * cup**2
    integral = quad(lambda t: depth(t) * np.cos(t) * np.sin(t), 0.0, 1.0, limit=200, points=[np.arccos(0.4 / e)])[0]
    want = area * modulus / material.thickness * integral
    got = cc.ElasticFoundation(hip.scene, (230, 230))(in_cup(hip.scene, e * pole(hip.scene)))[0, :3]
    np.testing.assert_allclose(np.linalg.norm(got), want, rtol=1e-3)


def test_turning_the_displacement_about_the_cups_axis_turns_the_loads_with_it(hip):
    fine = cc.ElasticFoundation(hip.scene, (200, 200))
    along = pole(hip.scene)
    displacement = 0.45 * Rotation.from_rotvec(0.3 * np.array([1.0, 0.0, 0.0])).apply(along)
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.0, 5.5, 8), along))
    loads = fine(in_cup(hip.scene, turns.apply(displacement)))
    size = np.linalg.norm(loads[0, :3])
    np.testing.assert_allclose(loads[:, :3], turns.apply(loads[0, :3]), atol=2e-3 * size)
    # ... and a ball is pressed along its displacement, through the cup's centre.
    np.testing.assert_allclose(loads[:, :3] / size, turns.apply(displacement / 0.45), atol=2e-3)
    np.testing.assert_allclose(
        loads[:, 3:], np.cross(hip.scene.geometry["cup_centre"], loads[:, :3]), rtol=1e-9, atol=1e-6 * size
    )


def test_a_button_in_the_middle_rides_both_facets_alike_and_without_torque_about_the_grooves_axis():
    """At flexion along the x axis: equal facets, no vertical force; forces of surfaces of revolution meet the axis."""
    patella = cc.ElasticFoundation(cc.load_scene("patellofemoral"), (100, 40))
    medial, lateral = patella.wrenches(np.array([[-49.8, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]
    assert medial[0] == pytest.approx(lateral[0])
    assert medial[0] > 100.0
    slope = np.deg2rad(patella.scene.geometry["facet_angle_deg"])
    assert medial[2] / medial[0] == pytest.approx(np.tan(slope), rel=0.05)
    assert lateral[2] == pytest.approx(-medial[2])
    for wrench in (medial, lateral):
        assert abs(wrench[1]) < 1e-9 * wrench[0]
        assert abs(wrench[5]) < 1e-9 * wrench[0]
