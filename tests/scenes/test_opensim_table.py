"""OpenSim files: round trips to the bit, headers of all versions, and faults named by file and line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.scenes.opensim import Table, read_opensim_table, write_table
from tests.support.shared_data import shared_file

_TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="="), max_size=12).map(str.strip)
_TEXT = _TEXT.filter(lambda text: text.lower() != "endheader")
_LABELS = st.lists(_TEXT.filter(lambda text: text and text.lower() != "time"), unique=True, max_size=4)


@st.composite
def tables(draw):
    labels, rows = ["time", *draw(_LABELS)], draw(st.integers(0, 5))
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    columns = {label: np.array(draw(st.lists(numbers, min_size=rows, max_size=rows))) for label in labels}
    return Table(draw(_TEXT), columns, draw(st.sampled_from([None, True, False])))


@given(tables())
def test_reading_gives_back_what_was_written_to_the_bit(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("sto") / "table.sto"
    write_table(table, path)
    back = read_opensim_table(path)
    assert (back.name, back.in_degrees, list(back.columns)) == (table.name, table.in_degrees, list(table.columns))
    for label, curve in table.columns.items():
        assert curve.tobytes() == back.columns[label].tobytes()


def write(tmp_path, text):
    path = tmp_path / "walk.mot"
    path.write_text(text)
    return path


def test_spaces_between_columns_old_headers_and_comments_are_understood(tmp_path):
    head = "Coordinates\nversion=1\nUnits are S.I.\nnrows=2\nnColumns = 2\n\ninDegrees=no\nendheader\n"
    table = read_opensim_table(write(tmp_path, head + "time\tknee angle\t\n  0.0\t1e-3\n0.5 \t -2\n\n"))
    assert (table.name, table.in_degrees) == ("Coordinates", False)
    np.testing.assert_array_equal(table.column("knee angle"), [1e-3, -2.0])
    simm = "name walk\ndatacolumns 2\ndatarows 2\nrange 0 1\nendheader\ntime\ta\n0\t1\n1\t2\n"
    assert read_opensim_table(write(tmp_path, simm)).column("a").tolist() == [1.0, 2.0]
    spaced = read_opensim_table(write(tmp_path, "DataType=double\nversion=3\nendheader\n time  a  b \n 0 1 2\n"))
    assert (spaced.name, spaced.in_degrees, spaced.column("b").tolist()) == ("", None, [2.0])


def test_a_measured_file_of_version_3_is_read():
    table = read_opensim_table(shared_file("data/dm_tka/fluoroscopic_gait.sto"))
    assert (len(table), len(table.columns)) == (101, 7)
    assert table.column("knee_rot_r")[0] == -0.09429999999999999


HEAD = "walk\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\n"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (HEAD + "time\ta\tb\n0\t1\t2\n", "line 8: nrows"),
        ("walk\ndatacolumns 3\nendheader\ntime\ta\n0\t1\n", "line 4: datacolumns"),
        (HEAD + "time\ta\tb\n0\t1\t2\n1\t1\n", "line 9"),
        (HEAD + "time\ta\tb\n0\t1\t1,2,3\n", "vectors"),
        (HEAD + "time\ta\ta\n0\t1\t2\n1\t1\t2\n", "twice"),
        (HEAD + "time\ta\tb\n0\t1\tnan\n1\t1\t2\n", "line 8, b"),
        (HEAD + "time\ta\tb\n0\tx\t2\n1\t1\t2\n", "line 8, a"),
        (HEAD + "a\tb\ttime\n", "first label"),
        (HEAD, "ends after"),
        ("walk\ninDegrees=maybe\nendheader\ntime\n", "inDegrees"),
        ("", "endheader"),
    ],
)
def test_a_fault_is_named_by_file_and_line(tmp_path, text, word):
    with pytest.raises(ValueError, match=word):
        read_opensim_table(write(tmp_path, text))


@pytest.mark.parametrize(
    ("columns", "word"),
    [
        ({"a": [1.0]}, "time"),
        ({"time": [0.0], "a\tb": [1.0]}, "tabs"),
        ({"time": [0.0], "a": [1.0, 2.0]}, "times"),
        ({"time": [0.0], "a": [np.nan]}, "finite"),
    ],
)
def test_a_table_that_no_file_can_hold_is_refused(columns, word):
    with pytest.raises(ValueError, match=word):
        Table("walk", columns)
