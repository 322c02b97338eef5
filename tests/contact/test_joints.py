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


def test_a_callable_with_a_magnitude_needs_gaps(hip):
    scene = hip.scene
    poses = in_cup(scene, np.array([[0.1, 0.2, 0.1], 0.45 * pole(scene)]))
    with pytest.raises(ValueError, match="needs the model's gaps"):
        cc.CallableModel(scene, hip.wrenches).root_loads(poses)
    own = cc.CallableModel(scene, hip.wrenches, hip.gaps)
    for mine, theirs in zip(own.root_loads(poses), hip.root_loads(poses), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-3, atol=2e-2)
