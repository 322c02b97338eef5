"""Charts are drawn from a stored result file alone, and their families can be told apart in grey."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from casadi_contact.pictures.charts import CHARTS, MARKERS, draw_charts, draw_speed_accuracy, family_styles
from casadi_contact.pictures.page import COLOURS
from casadi_contact.workflow.benchmark.front_file import Front, Point, read_front
from tests.support.shared_data import SPEED_ACCURACY as STORED


@pytest.fixture(scope="module")
def front():
    return read_front(STORED)


def lightness(colour):
    """CIE L* of an sRGB colour "#rrggbb", 0 (black) to 100 (white)."""
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = linear @ [0.2126, 0.7152, 0.0722]
    return 116.0 * np.cbrt(y) - 16.0 if y > 0.008856 else 903.3 * y


def test_every_chart_is_drawn_from_the_file(front, tmp_path):
    paths = draw_charts(front, tmp_path)
    assert {path.name for path in paths} == {f"{name}.{ending}" for name in CHARTS for ending in ("png", "svg")}
    assert all(path.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml") for path in paths)
    assert sorted(tmp_path.iterdir()) == sorted(paths)


@pytest.mark.parametrize(("loads", "drawn"), [("Fy_med Fx", "force"), ("Tz", "torque")])
def test_forces_alone_and_torques_alone_have_one_panel(front, loads, drawn):
    def reduced(point):
        return replace(point, load_rms={load: rms for load, rms in point.load_rms.items() if load in loads.split()})

    few = Front({**front.header, "loads": loads}, tuple(reduced(point) for point in front.points))
    for name, draw in CHARTS.items():
        axes = draw(few).axes
        assert len(axes) == (2 if name == "gradient_hessian_time" else 1)
        assert all(f"RMS {drawn} error" in axis.get_ylabel() for axis in axes)
        assert all(line.get_xydata().size for axis in axes for line in axis.lines)


def test_the_families_of_the_file_differ_in_lightness_colour_and_marker(front):
    styles = family_styles([point.family for point in front.points])
    first = [styles[family] for family in ("patch", "EF", "two_stage")]
    for one, other in combinations(first, 2):
        assert abs(lightness(one.colour) - lightness(other.colour)) > 15.0
    for one, other in combinations(styles.values(), 2):
        assert one.marker != other.marker
        assert one.colour != other.colour


def test_no_two_of_many_families_look_the_same():
    styles = family_styles([f"family {i}" for i in range(24)])
    assert len({(s.colour, s.marker, s.hollow) for s in styles.values()}) == 24
    assert len(COLOURS) == len(MARKERS)


def test_every_point_is_labelled_no_label_covers_another_and_failures_are_in_the_footnote(front):
    failed = Point("Kriging 50000", "Kriging", failure="the matrix does not fit in memory")
    figure = draw_speed_accuracy(replace(front, points=(*front.points, failed)))
    assert "Kriging 50000: the matrix does not fit" in figure._supxlabel.get_text()
    for axis in figure.axes:
        boxes = [text.get_window_extent() for text in axis.texts]
        assert len(boxes) == sum(not point.failure for point in front.points)
        for one, other in combinations(boxes, 2):
            assert not one.overlaps(other)
