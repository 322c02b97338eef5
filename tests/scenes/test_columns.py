"""Columns and poses go into a CSV file and come back as they were; a file that is none is refused with its place."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.scenes.columns import read_columns, write_columns
from casadi_contact.scenes.opensim import poses_table, write_table
from casadi_contact.scenes.pose_file import read_poses, read_poses_over_time, write_poses

POSES = np.random.default_rng(2).normal(size=(5, 6))


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_come_back_bit_by_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("columns") / "table.csv"
    write_columns(path, {"a": numbers, "b": range(len(numbers))})
    back = read_columns(path, required=("b", "a"))
    assert (back["a"].tolist(), back["b"].tolist()) == (numbers, list(range(len(numbers))))


def test_columns_of_different_lengths_leave_the_old_file_in_place(tmp_path):
    path = tmp_path / "t.csv"
    write_columns(path, {"x": [1.0]})
    with pytest.raises(ValueError, match="lengths"):
        write_columns(path, {"x": [1.0, 2.0], "y": [1.0]})
    assert read_columns(path, required=("x",))["x"].tolist() == [1.0]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("x,y\n", "header only"),
        ("x,y\n1\n", "line 2: got 1 values, expected 2"),
        ("x\n1\n", "lacks the columns y; it has x"),
        ("x,y,x\n1,2,3\n", "column x more than once"),
        ("x,y\n1,2\n\n3,three\n", "line 4, y: got 'three'"),
        ("x,y\n1,inf\n", "line 2, y: got inf, expected a finite number"),
        ("x,y\n1,5,2,5\n", "are there commas in numbers"),
        ('x,y\n"1,5","2,5"\n', "decimal point"),
        ("x;y\n1,5;2,5\n", "semicolons"),
        ("x\ty\n1\t2\n", "tabs"),
        ("x,y\n1,2\n,\n , \n3,4\n", "line 3"),  # a lost track: without these frames a path would be cut short
        ("knöchel,x,y\n0,1,2\n".encode("utf-16"), "save it as CSV UTF-8"),
        ("knöchel,x,y\n0,1,2\n".encode("latin-1"), "save it as CSV UTF-8"),
    ],
)
def test_what_is_no_table_of_these_numbers_is_refused_with_its_place(tmp_path, text, said):
    (tmp_path / "t.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(ValueError, match=said):
        read_columns(tmp_path / "t.csv", required=("x", "y"))


def test_poses_are_read_back_from_csv_bit_by_bit_and_from_opensims_in_mm_and_rad(tmp_path):
    write_poses(np.arange(5.0), POSES, tmp_path / "poses.csv")
    lines = (tmp_path / "poses.csv").read_text().splitlines()
    (tmp_path / "poses.csv").write_text("\n".join(f"{line},text" for line in lines))  # as tables of results have
    time_s, poses = read_poses_over_time(tmp_path / "poses.csv")
    np.testing.assert_array_equal(time_s, np.arange(5.0))
    np.testing.assert_array_equal(poses, POSES)
    write_table(poses_table(np.arange(5.0), POSES, "poses"), tmp_path / "poses.sto")
    np.testing.assert_allclose(read_poses(tmp_path / "poses.sto"), POSES, rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tx_mm,ty_mm\n1,2\n", "lacks the columns tz_mm, rx_rad, ry_rad, rz_rad"),
        ("tx_m,ty_m,tz_m,rx_deg,ry_deg,rz_deg\n1,2,3,4,5,6\n", "lacks the columns tx_mm"),
        ("tx,ty,tz,rx,ry,rz\n1,2,3,0,0,60\n", "rz reaches 60, expected radians"),
        ("time,tx,ty,tz,rx,ry,rz\n1,1,2,3,0,0,0\n0,1,2,3,0,0,0\n", "sort rows"),
    ],
)
def test_files_without_poses_are_refused(tmp_path, text, said):
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(ValueError, match=re.escape(said)):
        read_poses(tmp_path / "poses.csv")
