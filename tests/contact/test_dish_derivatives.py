"""Derivatives by the dish's radii: those of the loads and depths of knees with other dishes."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.polar.quadrature import RADII, dish_derivatives, patch_loads, patch_moments
from casadi_contact.core.conventions import rotation
from tests.support.ready_poses import KNEE

RAYS = Rays(48, 5)
STEP_MM = 1e-3
POSES = np.array([KNEE, [-1.0, 27.3, 0.4, 0.002, 0.06, -0.15], [2.0, 27.1, -0.5, -0.003, -0.1, -1.2]])


def foundation(**radii):
    return cc.PolarFoundation(cc.load_scene("knee", **radii), RAYS, compiled=False)


@pytest.mark.parametrize("radius", range(2))
def test_loads_and_depths_change_with_the_radii_as_those_of_other_knees(radius):
    knee = foundation()
    R, t = rotation(POSES[:, 3:]), POSES[:, :3]
    assert not knee.at_edge(POSES).any()
    at = knee.scene.geometry[RADII[radius]]
    others = [foundation(**{RADII[radius]: at + sign * STEP_MM}) for sign in (1.0, -1.0)]
    for p, patch in enumerate(knee.patches):
        wrenches, there, depths = dish_derivatives(patch, knee.law, RAYS, R, t)
        more, less = (patch_loads(o.patches[p], o.law, RAYS, R, t).wrench for o in others)
        expected = (more - less) / (2.0 * STEP_MM)
        assert np.abs(expected).max() > 100.0
        np.testing.assert_allclose(wrenches[..., radius], expected, atol=2e-4 * np.abs(expected).max())
        np.testing.assert_allclose(there.depth, patch_moments(patch, knee.law, RAYS, R, t)[0][:, 5])
        more, less = (patch_moments(o.patches[p], o.law, RAYS, R, t)[0][:, 5] for o in others)
        np.testing.assert_allclose(depths[:, radius], (more - less) / (2.0 * STEP_MM), atol=1e-5)
