"""Centres of pressure: where a force crosses the plane through the origin, whichever axis presses."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.normal_load import centre_of_pressure, normal_loads


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
    ("scene", "name", "said"),
    [
        ("hip", "cop_x", "cop_x: the scene's patches are not pressed in one direction"),
        ("knee", "cop_y", "unknown centre of pressure 'cop_y' of a scene pressed along Fy, expected cop_x, cop_z"),
        ("patellofemoral", "cop_ap", "of a scene pressed along Fx, expected cop_y, cop_z"),
    ],
)
def test_a_centre_that_a_scene_does_not_have_is_refused(scene, name, said):
    with pytest.raises(ValueError, match=said):
        centre_of_pressure(name, cc.load_scene(scene).normal_loads)
