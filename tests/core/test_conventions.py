"""Rotations, poses and named loads."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import (
    POSE_NAMES,
    angular_velocity_map,
    as_poses,
    finite_numbers,
    load_selection,
    rotation,
)

angles = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(angles)
def test_rotation_is_the_body_fixed_xyz_product(a):
    R = rotation(a)
    np.testing.assert_allclose(R, Rotation.from_euler("XYZ", a).as_matrix(), atol=1e-14)


@given(angles, st.integers(0, 2))
def test_angular_velocity_map_is_the_rate_of_the_rotation(a, axis):
    h, a = 1e-6, np.array(a)
    step = h * np.eye(3)[axis]
    spin = (rotation(a + step) - rotation(a - step)) / (2 * h) @ rotation(a).T
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(angular_velocity_map(a)[:, axis], omega, atol=1e-8)


class Frame(dict):
    """As a table of named columns, such as pandas' or Polars'."""

    columns = property(list)

    def __getitem__(self, names):
        return np.stack([self.get(name) for name in names], axis=1)


@pytest.mark.parametrize("names", [POSE_NAMES, ("tx_mm", "ty_mm", "tz_mm", "rx_rad", "ry_rad", "rz_rad")])
def test_columns_of_a_table_are_taken_by_name(names):
    table = Frame({name: np.array([float(k)]) for k, name in reversed([*enumerate(names)])})
    assert as_poses(table).tolist() == [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]]


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        (np.zeros((3, 5)), "shape"),
        ([[0, 0, 0, 0, 0, np.nan]], "rz"),
        ([[0, np.inf, 0, 0, 0, 0]], "ty"),
        ([["a", 0, 0, 0, 0, 0]], "numbers"),
        (np.zeros((1, 6), complex), "complex"),
        (np.ma.masked_equal(np.arange(6.0)[None], 2.0), "tz"),
        (Frame(zip("abcdef", np.zeros((6, 1)), strict=True)), "columns a, b"),
    ],
)
def test_bad_poses_are_refused_with_what_was_got(poses, said):
    with pytest.raises(ValueError, match=said):
        as_poses(poses)


def test_named_loads_pick_a_patch_or_the_sum():
    wrenches = np.arange(24.0).reshape(2, 2, 6)
    S = load_selection(("Fy_med", "Fy_lat", "Fy", "Tz"), ("med", "lat"))
    loads = np.einsum("lpk,npk->nl", S, wrenches)
    np.testing.assert_array_equal(loads[:, 0], wrenches[:, 0, 1])
    np.testing.assert_array_equal(loads[:, 0] + loads[:, 1], loads[:, 2])
    np.testing.assert_array_equal(loads[:, 3], wrenches[:, :, 5].sum(axis=1))
    with pytest.raises(ValueError, match="Fy_medial"):
        load_selection(("Fy_medial",), ("med", "lat"))


@pytest.mark.parametrize("value", ["x", 1j, np.array([1.0 + 1j]), np.nan, [[1.0], [1.0, 2.0]], None, ca.MX.sym("x")])
def test_what_is_no_finite_number_is_told_from_numbers(value):
    assert finite_numbers(value) is None
