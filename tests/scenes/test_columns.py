"""Columns go into a CSV file and come back as they were; a file that is none is refused, and none is half written."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.scenes.columns import read_columns, write_columns


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_come_back_bit_by_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("columns") / "table.csv"
    write_columns(path, {"a": numbers, "b": range(len(numbers))})
    back = read_columns(path, required=("b", "a"))
    assert back["a"].tolist() == numbers
    assert back["b"].tolist() == list(range(len(numbers)))


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
        ("", "is empty, expected a header and rows"),
        ("x,y\n", "has a header only, expected rows below it"),
        ("x,y\n1\n", "line 2: got 1 values, expected 2"),
        ("x\n1\n", "lacks the columns y; it has x"),
        ("x,y,x\n1,2,3\n", "has the column x more than once"),
        ("x,y\n1,2\n\n3,three\n", "line 4, y: got 'three', expected a number"),
        ("x,y\n1,1_0\n", "line 2, y: got '1_0', expected a number"),
        ("x,y\n1,inf\n", "line 2, y: got inf, expected a finite number"),
        ("x,y\n1,5,2,5\n", "line 2: got 4 values, expected 2: are there commas in numbers"),
        ('x,y\n"1,5","2,5"\n', "line 2, x: got '1,5', expected a number with a decimal point"),
        ("x;y\n1,5;2,5\n", "has semicolons between its columns, expected commas"),
        ("x\ty\n1\t2\n", "has tabs between its columns, expected commas"),
    ],
)
def test_what_is_no_table_of_these_numbers_is_refused_with_its_place(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ValueError, match=said):
        read_columns(tmp_path / "t.csv", required=("x", "y"))


def test_text_in_another_encoding_is_refused_with_the_cure(tmp_path):
    for label, encoding in (("knöchel", "utf-16"), ("ankle", "utf-16-le"), ("knöchel", "latin-1")):
        (tmp_path / "t.csv").write_bytes(f"{label},x,y\n0,1,2\n".encode(encoding))
        with pytest.raises(ValueError, match="save it as CSV UTF-8"):
            read_columns(tmp_path / "t.csv", required=("x", "y"))


def test_a_frame_whose_cells_are_empty_is_not_left_out(tmp_path):
    """As exports write a lost track: without these frames a path would be cut short."""
    (tmp_path / "t.csv").write_text("x,y\n1,2\n,\n , \n3,4\n")
    with pytest.raises(ValueError, match="line 3"):
        read_columns(tmp_path / "t.csv", required=("x", "y"))
