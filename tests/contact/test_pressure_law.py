"""Pressure laws: compiled values are the formulas, slopes and curvatures their derivatives."""

import numpy as np
import pytest

from casadi_contact.contact.pressure_law import compile_laws, law_number, pressure, pressures
from casadi_contact.scenes.material import LAWS

K, H = 2140.0, 8.0


@pytest.mark.parametrize("name", LAWS)
def test_slope_and_curvature_are_derivatives_on_both_sides_of_the_tangent(name):
    step, number = 1e-5, law_number(name)
    for depth in (1e-3, 0.1, 2.0, 0.89 * H, 0.91 * H, 3.0 * H):
        p, slope, curvature = pressure(number, K, H, depth)
        ends = [pressure(number, K, H, depth + way * step) for way in (1.0, -1.0)]
        assert slope == pytest.approx((ends[0][0] - ends[1][0]) / (2.0 * step), rel=1e-7)
        assert curvature == pytest.approx((ends[0][1] - ends[1][1]) / (2.0 * step), rel=1e-6, abs=1e-6 * slope)
        assert p > 0.0


def test_laws_are_their_formulas_and_agree_for_thin_strains():
    depths = np.array([-1.0, 0.0, 0.01, 1.0, 4.0])
    linear, log = (pressures(law_number(name), K, H, depths) for name in ("linear", "log"))
    np.testing.assert_allclose(linear, K * np.maximum(depths, 0.0) / H, rtol=1e-15)
    np.testing.assert_allclose(log, -K * np.log(1.0 - np.maximum(depths, 0.0) / H), rtol=1e-13)
    assert log[2] == pytest.approx(linear[2], rel=1e-3)


def test_a_new_law_is_one_more_function():
    def quadratic(modulus, thickness, depth):
        return modulus * depth**2, 2.0 * modulus * depth, 2.0 * modulus

    compiled = compile_laws([*LAWS.values(), quadratic])
    assert compiled(len(LAWS), 3.0, H, 2.0) == (12.0, 12.0, 6.0)
    for name in LAWS:
        assert compiled(law_number(name), K, H, 1.0) == pressure(law_number(name), K, H, 1.0)
