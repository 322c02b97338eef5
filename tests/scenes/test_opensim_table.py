"""OpenSim files: round trips to the bit, headers of all versions, and faults named by file and line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.scenes.opensim.table import Table, read_opensim_table, write_table
from tests.support.shared_data import shared_file

_TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="="), max_size=12).map(str.strip)
_TEXT = _TEXT.filter(lambda text: text.lower() != "endheader")
_WORD = st.from_regex(r"[A-Za-z]\w{0,6}", fullmatch=True).filter(
    lambda word: word.lower() not in ("version", "nrows", "ncolumns", "indegrees")
)
_LABELS = st.lists(_TEXT.filter(lambda text: text and text != "time"), unique=True, max_size=4)


@st.composite
def tables(draw):
    labels = ["time", *draw(_LABELS)]
    rows = draw(st.integers(0, 5))
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    columns = {label: np.array(draw(st.lists(numbers, min_size=rows, max_size=rows))) for label in labels}
    return Table(
        draw(_TEXT),
        columns,
        draw(st.sampled_from([None, True, False])),
        draw(st.sampled_from([1, 2, 3])),
        draw(st.dictionaries(_WORD, _TEXT, max_size=2)),
        tuple(draw(st.lists(_TEXT.filter(bool), max_size=2))),
    )


@given(tables())
def test_reading_gives_back_what_was_written_to_the_bit(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("sto") / "table.sto"
    write_table(table, path)
    back = read_opensim_table(path)
    for key in ("name", "in_degrees", "version", "header", "notes"):
        assert getattr(back, key) == getattr(table, key)
    assert list(back.columns) == list(table.columns)
    for label, curve in table.columns.items():
        assert curve.tobytes() == back.columns[label].tobytes()
    text = path.read_bytes()
    write_table(back, path)
    assert path.read_bytes() == text


def write(tmp_path, text):
    path = tmp_path / "walk.mot"
    path.write_text(text)
    return path


def test_spaces_between_columns_old_headers_and_comments_are_understood(tmp_path):
    head = "Coordinates\nversion=1\nUnits are S.I.\nnRows=2\nnColumns = 2\n\ninDegrees=no\nendheader\n"
    path = write(tmp_path, head + "time\tknee angle\t\n  0.0\t1e-3\n0.5 \t -2\n\n")
    table = read_opensim_table(path)
    assert (table.name, table.version, table.in_degrees, table.notes) == ("Coordinates", 1, False, ("Units are S.I.",))
    np.testing.assert_array_equal(table.column("knee angle"), [1e-3, -2.0])
    simm = "name walk\ndatacolumns 2\ndatarows 2\nrange 0 1\nendheader\ntime\ta\n0\t1\n1\t2\n"
    assert read_opensim_table(write(tmp_path, simm)).column("a").tolist() == [1.0, 2.0]
    spaced = read_opensim_table(write(tmp_path, "DataType=double\nversion=3\nendheader\n time  a  b \n 0 1 2\n"))
    assert spaced.header == {"DataType": "double"}
    assert (spaced.name, spaced.in_degrees, spaced.column("b").tolist()) == ("", None, [2.0])


def test_a_measured_file_of_version_3_is_read(tmp_path):
    table = read_opensim_table(shared_file("data/dm_tka/fluoroscopic_gait.sto"))
    assert (table.version, len(table), len(table.columns)) == (3, 101, 7)
    assert table.column("knee_rot_r")[0] == -0.09429999999999999
    write_table(table, tmp_path / "again.sto")
    again = read_opensim_table(tmp_path / "again.sto")
    assert all(np.array_equal(again.columns[label], curve) for label, curve in table.columns.items())


HEAD = "walk\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + "time\ta\tb\n0\t1\t2\n", r"walk.mot line 8: the file ends after 1 rows, but nRows=2"),
        ("walk\ndatarows 2\nendheader\ntime\ta\n0\t1\n", r"walk.mot line 5: the file ends after 1 rows, but nRows=2"),
        ("walk\ndatacolumns 3\nendheader\ntime\ta\n0\t1\n", r"walk.mot line 4: 2 labels, but nColumns=3"),
        (HEAD + "time\ta\tb\n0\t1\t2\n1\t1\n", r"walk.mot line 9: got 2 values, expected 3"),
        (HEAD + "time\ta\tb\n0\t1\t1,2,3\n", r"walk.mot line 8 has vectors"),
        (HEAD + "time\ta\ta\n0\t1\t2\n1\t1\t2\n", r"walk.mot line 7: the column 'a' is there twice"),
        (HEAD + "Time\ttime\ta\n0\t1\t2\n1\t1\t2\n", r"walk.mot line 7: the column 'time' is there twice"),
        (HEAD + "time\ta\n0\t1\n1\t1\n", r"walk.mot line 7: 2 labels, but nColumns=3"),
        (HEAD + "time\ta\tb\n0\t1\tnan\n1\t1\t2\n", r"walk.mot line 8, b: got nan, expected a finite number"),
        (HEAD + "time\ta\tb\n0\tx\t2\n1\t1\t2\n", r"walk.mot line 8, a: got 'x', expected a number"),
        ("inDegrees=no\ninDegrees=yes\n" + HEAD, r"walk.mot line 2: inDegrees is 'no' and 'yes', expected one of them"),
        (HEAD + "time\ta\tb\n0\t1_0\t2\n1\t1\t2\n", r"walk.mot line 8, a: got '1_0', expected a number"),
        (HEAD + "a\tb\ttime\n", r"walk.mot line 7: the first label is 'a', expected 'time'"),
        (HEAD, r"walk.mot ends after its header"),
        ("walk\nversion=1\ntime\ta\n", r"walk.mot has no line 'endheader'"),
        ("walk\nversion=9\nendheader\ntime\ta\n0\t1\n", r"walk.mot: version is 9, expected one of"),
        ("walk\nnRows=two\nendheader\ntime\n", r"walk.mot: nRows is 'two', expected a whole number"),
        ("walk\ninDegrees=maybe\nendheader\ntime\n", r"walk.mot: inDegrees is 'maybe', expected yes or no"),
        ("", r"walk.mot has no line 'endheader'"),
    ],
)
def test_a_fault_is_named_by_file_and_line(tmp_path, text, said):
    with pytest.raises(ValueError, match=said):
        read_opensim_table(write(tmp_path, text))


def test_no_file_a_folder_and_binary_data_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none.sto does not exist"):
        read_opensim_table(tmp_path / "none.sto")
    with pytest.raises(FileNotFoundError, match="is a folder"):
        read_opensim_table(tmp_path)
    (tmp_path / "walk.mot").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="is not a text file"):
        read_opensim_table(tmp_path / "walk.mot")


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"a": [1.0]}, "the first column is 'a', expected 'time'"),
        ({"time": [0.0], "a\tb": [1.0]}, "holds tabs"),
        ({"time": [0.0], "a": [1.0, 2.0]}, "columns have different lengths"),
        ({"time": [0.0], "a": [np.nan]}, "not a row of finite numbers"),
    ],
)
def test_a_table_that_no_file_can_hold_is_refused(columns, said):
    with pytest.raises(ValueError, match=said):
        Table("walk", columns)


def test_keys_of_the_header_may_be_in_small_letters(tmp_path):
    path = tmp_path / "walk.sto"
    path.write_text("walk\nversion=1\nnrows=1\nncolumns=2\nindegrees=yes\nendheader\ntime\tknee\n0\t-60\n")
    table = read_opensim_table(path)
    assert table.in_degrees is True
    assert table.header == {}
    path.write_text(path.read_text().replace("nrows=1", "nrows=2"))
    with pytest.raises(ValueError, match="nRows=2: truncated"):
        read_opensim_table(path)
