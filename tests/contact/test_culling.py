"""Culling leaves out no point that may touch: bounds lie below the distance at every point of a block."""

import numpy as np
import pytest

from casadi_contact.contact.elements.loops import block_bound, point_bound
from casadi_contact.geometry.moving_surface import MESH_FIELD

HOLLOW_MM = 30.0  # a body around a spherical hollow: g = R - |p|, bent towards the body, as in the notch of a femur


@pytest.mark.parametrize("from_middle_mm", [20.0, 26.0, 29.5])
@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.6, -0.8, 0.0], [1.0, 1.0, 1.0]])
def test_bounds_hold_at_all_points_of_a_block_in_a_hollow(from_middle_mm, direction):
    outwards = np.array(direction) / np.linalg.norm(direction)
    centre, half = from_middle_mm * outwards, np.array([1.0, 0.3, 1.5])
    curvature = 1.0 / (from_middle_mm - np.linalg.norm(half))  # the largest in the block
    tangent = (HOLLOW_MM - from_middle_mm, *-outwards, curvature)
    offsets = half * np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 3), axis=-1).reshape(-1, 3)
    distances = HOLLOW_MM - np.linalg.norm(centre + offsets, axis=1)
    bound = block_bound.py_func(MESH_FIELD, tangent, half[None], 0)
    bounds = np.array([point_bound.py_func(tangent, *offset) for offset in offsets])
    assert bound <= distances.min()
    assert (bounds <= distances + 1e-12).all()
    assert (distances - bounds).max() < 2.0 * curvature * half @ half  # and not so low that nothing is left out
    if distances.min() > 1.0:
        assert bound > 0.0
