"""Normal loads: along a signed direction or a magnitude, and the same scenes as before."""

import numpy as np
import pytest

from casadi_contact.scenes.normal_load import normal_loads

SIDES = ("med", "lat")


def test_the_sign_says_which_way_a_patch_is_pressed():
    below, front = normal_loads(["Fy_med", "+Fx_lat"], SIDES)
    wrench = np.array([3.0, -700.0, 4.0, 1.0, 2.0, 5.0])
    assert below.of(wrench) == 700.0
    assert front.of(wrench) == 3.0
    np.testing.assert_array_equal(below.direction, [0.0, -1.0, 0.0])
    np.testing.assert_array_equal(front.direction, [1.0, 0.0, 0.0])
    assert (below.loads, front.loads) == (("Fy_med",), ("Fx_lat",))
    assert normal_loads(["-Fy_med", "+Fx_lat"], SIDES)[0].sign == below.sign


def test_a_magnitude_and_its_slope():
    (hip,) = normal_loads(["F"], ("contact",))
    assert hip.loads == ("Fx", "Fy", "Fz")
    assert hip.direction is None
    rng = np.random.default_rng(0)
    wrench, slopes, h = rng.normal(size=(5, 6)), rng.normal(size=(5, 6, 3)), 1e-6
    np.testing.assert_allclose(hip.of(wrench), np.sqrt((wrench[:, :3] ** 2).sum(axis=1)))
    for j in range(3):
        difference = (hip.of(wrench + h * slopes[..., j]) - hip.of(wrench - h * slopes[..., j])) / (2 * h)
        np.testing.assert_allclose(hip.gradient(wrench, slopes)[:, j], difference, rtol=1e-7)
    assert not hip.gradient(np.zeros((2, 6)), slopes[:2]).any()


def test_one_name_without_patch_holds_for_each_patch():
    assert normal_loads(["+Fx"], SIDES) == normal_loads(["+Fx_med", "+Fx_lat"], SIDES)
    assert normal_loads(["Fy"], ("contact",))[0].loads == ("Fy",)


def test_loads_are_brought_to_a_size_without_turning_a_force():
    below, front = normal_loads(["Fy_med", "+Fx_lat"], SIDES)
    forces = np.array([[-700.0], [-2.0], [3.0]])
    np.testing.assert_array_equal(below.with_size(forces, 5.0), [[-5.0], [-5.0], [-5.0]])
    np.testing.assert_array_equal(below.at_least(forces, 5.0), [[-700.0], [-5.0], [-5.0]])
    np.testing.assert_array_equal(front.at_least(forces, 5.0), [[5.0], [5.0], [5.0]])
    (hip,) = normal_loads(["F"], ("contact",))
    np.testing.assert_allclose(hip.with_size(np.array([[30.0, 40.0, 0.0]]), 5.0), [[3.0, 4.0, 0.0]])
    np.testing.assert_allclose(
        hip.at_least(np.array([[30.0, 40.0, 0.0], [0.0, 0.0, -1.0]]), 5.0), [[30, 40, 0], [0, 0, -5]]
    )


@pytest.mark.parametrize(
    ("names", "patches", "said"),
    [
        (["Fy_med"], SIDES, "expected one load for each of the patches med, lat"),
        (["Fy_med", "Fx_med"], SIDES, "expected one load for each"),
        (["Fy", "Fy_lat"], SIDES, "unknown load 'Fy'"),
        (["Ty"], ("contact",), "unknown load 'Ty'.*-Fx_contact"),
        (["-F"], ("contact",), "unknown load '-F'"),
    ],
)
def test_other_text_is_refused(names, patches, said):
    with pytest.raises(ValueError, match=said):
        normal_loads(names, patches)
