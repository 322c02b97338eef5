"""Normal loads, along a signed direction or a magnitude, and centres of pressure, whichever axis presses."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.normal_load import centre_of_pressure, normal_loads

SIDES = ("med", "lat")


def test_the_sign_says_which_way_a_patch_is_pressed():
    below, front = normal_loads(["Fy_med", "+Fx_lat"], SIDES)
    wrench = np.array([3.0, -700.0, 4.0, 1.0, 2.0, 5.0])
    assert (below.of(wrench), front.of(wrench)) == (700.0, 3.0)
    np.testing.assert_array_equal([below.direction, front.direction], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    assert (below.loads, front.loads) == (("Fy_med",), ("Fx_lat",))
    assert normal_loads(["+Fx"], SIDES) == normal_loads(["+Fx_med", "+Fx_lat"], SIDES)
    assert normal_loads(["Fy"], ("contact",))[0].loads == ("Fy",)


def test_a_magnitude_and_its_slope():
    (hip,) = normal_loads(["F"], ("contact",))
    assert (hip.loads, hip.direction) == (("Fx", "Fy", "Fz"), None)
    rng = np.random.default_rng(0)
    wrench, slopes, h = rng.normal(size=(5, 6)), rng.normal(size=(5, 6, 3)), 1e-6
    np.testing.assert_allclose(hip.of(wrench), np.sqrt((wrench[:, :3] ** 2).sum(axis=1)))
    for j in range(3):
        difference = (hip.of(wrench + h * slopes[..., j]) - hip.of(wrench - h * slopes[..., j])) / (2 * h)
        np.testing.assert_allclose(hip.gradient(wrench, slopes)[:, j], difference, rtol=1e-7)
    assert not hip.gradient(np.zeros((2, 6)), slopes[:2]).any()


def test_loads_are_brought_to_a_size_without_turning_a_force():
    below, front = normal_loads(["Fy_med", "+Fx_lat"], SIDES)
    forces = np.array([[-700.0], [-2.0], [3.0]])
    assert below.with_size(forces, 5.0).ravel().tolist() == [-5.0, -5.0, -5.0]
    assert below.at_least(forces, 5.0).ravel().tolist() == [-700.0, -5.0, -5.0]
    assert front.at_least(forces, 5.0).ravel().tolist() == [5.0, 5.0, 5.0]
    (hip,) = normal_loads(["F"], ("contact",))
    np.testing.assert_allclose(hip.with_size(np.array([[30.0, 40.0, 0.0]]), 5.0), [[3.0, 4.0, 0.0]])
    forces = np.array([[30.0, 40.0, 0.0], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(hip.at_least(forces, 5.0), [[30, 40, 0], [0, 0, -5]])


@pytest.mark.parametrize("axis", range(3))
def test_a_force_at_a_point_has_its_centre_of_pressure_there(axis):
    point, force = np.array([3.0, -5.0, 7.0]), np.zeros(3)
    point[axis], force[axis] = 0.0, -800.0
    loads = dict(zip(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"), [*force, *np.cross(point, force)], strict=True))
    normals = normal_loads([f"-F{'xyz'[axis]}_only"], ["only"])
    for other in {0, 1, 2} - {axis}:
        found = centre_of_pressure(f"cop_{'xyz'[other]}_mm", normals)
        assert found.axis == other
        assert found.sign * loads[found.torque] / loads[found.force] == pytest.approx(point[other])


def test_a_knee_knows_its_directions_by_their_anatomical_names():
    normals = cc.load_scene("knee").normal_loads
    assert centre_of_pressure("cop_ap", normals) == centre_of_pressure("cop_x", normals)
    assert centre_of_pressure("cop_ml_mm", normals) == centre_of_pressure("cop_z", normals)
    assert centre_of_pressure("Fy_med", normals) is None


@pytest.mark.parametrize(
    ("names", "patches", "said"),
    [
        (["Fy_med"], SIDES, "expected one load for each of the patches med, lat"),
        (["Fy", "Fy_lat"], SIDES, "'Fy'"),
        (["Ty"], ("contact",), "'Ty'.*-Fx_contact"),
        ("hip", "cop_x", "not pressed in one direction"),
        ("knee", "cop_y", "expected cop_x, cop_z"),
        ("patellofemoral", "cop_ap", "expected cop_y, cop_z"),
    ],
)
def test_other_loads_and_centres_that_a_scene_does_not_have_are_refused(names, patches, said):
    def of_a_scene(name, centre):
        centre_of_pressure(centre, cc.load_scene(name).normal_loads)

    with pytest.raises(ValueError, match=said):
        (normal_loads if isinstance(names, list) else of_a_scene)(names, patches)
