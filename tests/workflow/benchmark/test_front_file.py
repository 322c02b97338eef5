"""The result file comes back as it was written, other tools can read it, and damage is named by its line."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.core.quantities import FORCE, TORQUE
from casadi_contact.pictures.charts import pareto
from casadi_contact.workflow.benchmark.front_file import Front, Point, Timing, read_front, write_front
from tests.support.shared_data import SPEED_ACCURACY as STORED


def lines_of(path):
    return path.read_text("utf-8").splitlines()


def test_texts_with_commas_quotes_and_line_breaks_stay_one_cell(tmp_path):
    point = Point("a", "A", value=Timing(2.0, 1.0, 3.0), load_rms={"Fx": 0.5}, remark='x, "y"\n# z')
    header = {"scene": "s", "scene_digest": "d", "loads": "Fx Tx"}
    write_front(tmp_path / "f.csv", Front(header, (point, Point("b", "B", failure="singular, 1e17"))))
    got = read_front(tmp_path / "f.csv")
    assert got.header == header
    assert got.points[0].remark == "x; 'y'  z"
    assert replace(got.points[0], remark="") == replace(point, remark="")
    assert got.points[1].failure == "singular; 1e17"
    assert got.points[1].value is None
    assert np.isnan(got.points[1].force_rms_n)


def test_what_was_written_is_what_is_read_by_numpy_as_well(tmp_path):
    front, path = read_front(STORED), tmp_path / "again.csv"
    write_front(path, front)
    assert read_front(path) == front
    comments = sum(line.startswith("#") for line in lines_of(path))
    table = np.genfromtxt(path, delimiter=",", names=True, skip_header=comments, dtype=None, encoding="utf-8")
    assert table["name"].tolist() == [point.name for point in front.points]
    times = [point.value.median_us if point.value else np.nan for point in front.points]
    np.testing.assert_allclose(table["value_us"], times, rtol=1e-5)


def test_force_and_torque_are_root_mean_squares_over_their_loads():
    point = Point("a", "A", load_rms={"Fx": 3.0, "Fz": 4.0, "Tx": 7.0})
    assert point.force_rms_n == pytest.approx(np.sqrt(12.5))
    assert point.torque_rms_nmm == 7.0
    assert point.rms(FORCE, ["Fz"]) == 4.0
    assert np.isnan(point.rms(TORQUE, ["Fz"]))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda lines: lines[1:], "format"),
        (lambda lines: [line.replace("# loads: ", "# loads: foo ") for line in lines], "foo"),
        (lambda lines: [line for line in lines if not line.startswith("name,")], "column"),
        (lambda lines: [*lines[:-1], lines[-1][:20]], "shorter"),
        (lambda lines: [*lines[:-1], lines[-1].replace(",A,", ",A,-", 1)], "value_us.*finite"),
        (lambda lines: [*lines[:-1], f'"{"9" * 140_000}"'], "field limit"),
        (lambda lines: ["\udcff"], "decode"),
    ],
)
def test_a_damaged_file_is_refused(damage, said, tmp_path):
    path = tmp_path / "f.csv"
    point = Point("a", "A", value=Timing(2.0, 1.0, 3.0), load_rms={"Fx": 0.5})
    write_front(path, Front({"scene": "s", "scene_digest": "d", "loads": "Fx Tx"}, (point,)))
    path.write_text("\n".join(damage(lines_of(path))) + "\n", "utf-8", errors="surrogateescape")
    with pytest.raises(ValueError, match=rf"f\.csv.*{said}"):
        read_front(path)
    with pytest.raises(FileNotFoundError, match="run casadi-contact chart first"):
        read_front(tmp_path / "none.csv")


@given(st.lists(st.tuples(st.floats(1, 9), st.floats(1, 9)), min_size=1))
def test_the_pareto_front_is_what_nothing_else_beats(points):
    best = [points[i] for i in pareto(points)]
    assert best == sorted(best)
    for cost, error in best:
        assert not any(c <= cost and e <= error and (c, e) != (cost, error) for c, e in points)
    for cost, error in points:
        assert any(c <= cost and e <= error for c, e in best)
