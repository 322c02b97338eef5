"""Charts are drawn from a stored result file alone, and their families can be told apart."""

from dataclasses import replace
from itertools import combinations

import pytest

from casadi_contact.pictures.charts import draw_speed_accuracy, family_styles, save
from casadi_contact.workflow.benchmark.front_file import Front, Point, read_front
from tests.support.shared_data import SPEED_ACCURACY as STORED


@pytest.fixture(scope="module")
def front():
    return read_front(STORED)


def test_the_chart_is_drawn_from_the_file(front, tmp_path):
    paths = save(draw_speed_accuracy(front), tmp_path, "chart")
    assert [path.name for path in paths] == ["chart.png", "chart.svg"]
    assert all(path.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml") for path in paths)


@pytest.mark.parametrize(("loads", "drawn"), [("Fy_med Fx", "force"), ("Tz", "torque")])
def test_forces_alone_and_torques_alone_have_one_panel(front, loads, drawn):
    def reduced(point):
        return replace(point, load_rms={load: rms for load, rms in point.load_rms.items() if load in loads.split()})

    few = Front({**front.header, "loads": loads}, tuple(reduced(point) for point in front.points))
    (axis,) = draw_speed_accuracy(few).axes
    assert f"RMS {drawn} error" in axis.get_ylabel()
    assert all(line.get_xydata().size for line in axis.lines)


def test_no_two_families_look_the_same():
    styles = family_styles([f"family {i}" for i in range(24)])
    assert len({tuple(style.values()) for style in styles.values()}) == 24


def test_every_family_is_labelled_no_label_covers_another_and_failures_are_in_the_footnote(front):
    failed = Point("Kriging 50000", "Kriging", failure="the matrix does not fit in memory")
    figure = draw_speed_accuracy(replace(front, points=(*front.points, failed)))
    assert "Kriging 50000: the matrix does not fit" in figure._supxlabel.get_text()
    for axis in figure.axes:
        families = {
            family: [p.name.removeprefix(f"{family} ") for p in front.points if p.family == family]
            for family in {p.family for p in front.points}
        }
        said = {text.get_text() for text in axis.texts}
        assert all(said & set(names) for names in families.values())
        boxes = [text.get_window_extent() for text in axis.texts]
        for one, other in combinations(boxes, 2):
            assert not one.overlaps(other)
