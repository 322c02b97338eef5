"""Poses over time come back from every file that holds them, and files that do not are refused by name."""

import re

import numpy as np
import pytest

from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim import poses_table, write_table
from casadi_contact.scenes.pose_file import read_poses, read_poses_over_time, write_poses

NAMES = ("tx_mm", "ty_mm", "tz_mm", "rx_rad", "ry_rad", "rz_rad")
POSES = np.random.default_rng(2).normal(size=(5, 6))
COLUMNS = dict(zip(NAMES, POSES.T, strict=True))


def test_a_csv_file_is_read_back_bit_by_bit(tmp_path):
    write_poses(np.arange(5.0), POSES, tmp_path / "poses.csv")
    np.testing.assert_array_equal(read_poses(tmp_path / "poses.csv"), POSES)
    time_s, poses = read_poses_over_time(tmp_path / "poses.csv")
    np.testing.assert_array_equal(time_s, np.arange(5.0))
    np.testing.assert_array_equal(poses, POSES)


def test_an_opensim_file_of_this_library_is_read_in_mm_and_rad(tmp_path):
    write_table(poses_table(np.arange(5.0), POSES, "poses"), tmp_path / "poses.sto")
    np.testing.assert_allclose(read_poses(tmp_path / "poses.sto"), POSES, rtol=1e-15)


def test_columns_of_result_tables_are_read_as_poses(tmp_path):
    """What problems write: names with units, beside text."""
    columns = {"time_s": np.arange(5.0), **COLUMNS, "reason": [""] * 5}
    write_columns(tmp_path / "poses.csv", columns)
    np.testing.assert_array_equal(read_poses(tmp_path / "poses.csv"), POSES)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tx_mm,ty_mm\n1,2\n", "lacks the columns tz_mm, rx_rad, ry_rad, rz_rad"),
        ("tx_m,ty_m,tz_m,rx_deg,ry_deg,rz_deg\n1,2,3,4,5,6\n", "lacks the columns tx_mm"),
        ("tx,ty,tz,rx,ry,rz\n1,2,3,0,0,60\n", "rz reaches 60, expected radians: is it in degrees?"),
        ("time,tx,ty,tz,rx,ry,rz\n1,1,2,3,0,0,0\n0,1,2,3,0,0,0\n", "expected rows sorted by time, and none twice"),
    ],
)
def test_files_without_poses_are_refused(tmp_path, text, said):
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(ValueError, match=re.escape(said)):
        read_poses(tmp_path / "poses.csv")
