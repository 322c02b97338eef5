"""Hip, shoulder and patella as contact problems: reference forces, symmetries, exact zeros, derivatives."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from tests.support.ready_poses import in_cup, pole


@pytest.fixture(scope="module")
def hip():
    return cc.ElasticFoundation(cc.load_scene("hip"), (60, 60))


@pytest.fixture(scope="module")
def patella():
    return cc.ElasticFoundation(cc.load_scene("patellofemoral"), (100, 40))


@pytest.mark.parametrize(
    ("cup_radius", "overlap", "force"), [(45.0, 0.1, 749.0413), (45.0, 0.2, 2966.6461), (33.0, 0.1, 2652.6872)]
)
def test_a_shallow_cup_gives_the_reference_forces_of_a_dish(cup_radius, overlap, force):
    scene = cc.load_scene("hip", ball_radius=30.0, cup_radius=cup_radius, cup_half_angle_deg=25.0)
    model = cc.ElasticFoundation(scene, (300, 300))
    along = pole(scene)
    got = model(in_cup(scene, (cup_radius - 30.0 + overlap) * along))[0, :3]
    np.testing.assert_allclose(got, force * along, rtol=1e-3)


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
    got = cc.ElasticFoundation(hip.scene, (240, 240))(in_cup(hip.scene, e * pole(hip.scene)))[0, :3]
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


def test_a_turn_of_the_ball_changes_nothing(hip):
    pose = in_cup(hip.scene, 0.45 * pole(hip.scene))
    turned = pose + np.array([0.0, 0.0, 0.0, 0.4, -0.3, 0.8])
    np.testing.assert_allclose(hip(turned), hip(pose), rtol=1e-9, atol=1e-6)


def test_all_six_loads_and_their_slopes_vanish_out_of_contact(hip):
    clearance = hip.scene.geometry["cup_radius"] - hip.scene.geometry["ball_radius"]
    directions = Rotation.random(20, random_state=0).apply([1.0, 0.0, 0.0])
    inside = in_cup(hip.scene, np.linspace(0.0, 0.999, 20)[:, None] * clearance * directions)
    loads, jacobian = hip.jacobian(inside)
    assert not loads.any()
    assert not jacobian.any()
    s, _ = hip.root_loads(inside)
    assert (s < 0.0).all()


@pytest.mark.parametrize("name", ["hip", "glenohumeral", "patellofemoral"])
def test_analytic_jacobians_and_root_slopes_agree_with_differences(name):
    scene = cc.load_scene(name)
    model = cc.ElasticFoundation(scene, (60, 60))
    rng = np.random.default_rng(1)
    if scene.shape == "ball_in_cup":
        depth = scene.geometry["cup_radius"] - scene.geometry["ball_radius"] + rng.uniform(0.02, 0.07, (20, 1))
        along = pole(scene) + rng.uniform(-0.1, 0.1, (20, 3))
        poses = in_cup(scene, depth * along / np.linalg.norm(along, axis=1, keepdims=True))
    else:
        poses = np.array([-49.85, 0.0, 0.0, 0.0, 0.0, -0.5]) + rng.uniform(-1.0, 1.0, (20, 6)) * [
            *(0.05, 2.0, 0.05, 0.02, 0.02, 0.3)
        ]
    assert (model.root_loads(poses)[0] > 0.0).all()
    h = 1e-7
    for function in (model.jacobian, model.root_loads):
        _, slopes = function(poses)
        differences = np.stack(
            [(function(poses + step)[0] - function(poses - step)[0]) / (2 * h) for step in h * np.eye(6)], axis=-1
        )
        scale = np.abs(slopes).max(axis=(0, 2), keepdims=True)
        assert np.quantile(np.abs(slopes - differences) / scale, 0.98) < 1e-5


def test_a_mirrored_patella_mirrors_the_loads(patella):
    rng = np.random.default_rng(2)
    poses = np.array([-49.9, 0.0, 0.0, 0.0, 0.0, -0.5]) + rng.uniform(-1.0, 1.0, (30, 6)) * [
        0.05,
        8.0,
        0.2,
        0.03,
        0.03,
        0.4,
    ]
    mirrored = patella.wrenches(poses * [1, 1, -1, -1, -1, 1])  # z -> -z: tz, rx and ry change sign
    wrenches = patella.wrenches(poses)
    assert (np.abs(wrenches[:, :, 0]) > 0.0).any(axis=0).all()
    np.testing.assert_allclose(mirrored[:, ::-1], wrenches * [1, 1, -1, -1, -1, 1], atol=1e-8)


def test_a_button_in_the_middle_rides_both_facets_alike_and_without_torque_about_the_grooves_axis(patella):
    """At flexion along the x axis: equal facets, no vertical force; forces of surfaces of revolution meet the axis."""
    medial, lateral = patella.wrenches(np.array([[-49.8, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]
    assert medial[0] == pytest.approx(lateral[0])
    assert medial[0] > 100.0
    slope = np.deg2rad(patella.scene.geometry["facet_angle_deg"])
    assert medial[2] / medial[0] == pytest.approx(np.tan(slope), rel=0.05)
    assert lateral[2] == pytest.approx(-medial[2])
    for wrench in (medial, lateral):
        assert abs(wrench[1]) < 1e-9 * wrench[0]
        assert abs(wrench[5]) < 1e-9 * wrench[0]


def test_pushing_the_button_sideways_loads_that_facet(patella):
    poses = np.array([[-49.85, 0.0, z, 0.0, 0.0, 0.0] for z in (-0.1, 0.0, 0.1)])
    fx = patella.wrenches(poses)[:, :, 0]
    assert (np.diff(fx[:, 0]) > 0.0).all()  # medial: z > 0
    assert (np.diff(fx[:, 1]) < 0.0).all()


def test_a_callable_with_a_magnitude_needs_gaps(hip):
    scene = hip.scene
    poses = in_cup(scene, np.array([[0.1, 0.2, 0.1], 0.45 * pole(scene)]))
    with pytest.raises(ValueError, match="needs the model's gaps"):
        cc.CallableModel(scene, hip.wrenches).root_loads(poses)
    own = cc.CallableModel(scene, hip.wrenches, hip.gaps)
    for mine, theirs in zip(own.root_loads(poses), hip.root_loads(poses), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-3, atol=2e-2)
