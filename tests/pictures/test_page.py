"""A page is made without a display, can measure its text, and is written whole in the format of its ending."""

import pytest

from casadi_contact.pictures.page import COLOURS, TARGET, frame, new_page, save_page


def drawn():
    page = new_page(3.0, 2.0)
    axis = page.subplots()
    axis.plot([0.0, 1.0], [0.0, 1.0], label="target", **TARGET)
    frame([axis], "time [s]")
    return page, axis


@pytest.mark.parametrize(("name", "begins"), [("p.png", b"\x89PNG"), ("p.svg", b"<?xml"), ("p", b"\x89PNG")])
def test_a_page_is_written_in_the_format_of_its_ending(tmp_path, name, begins):
    save_page(drawn()[0], tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(begins)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_dots_per_inch_set_the_size_of_a_picture(tmp_path):
    save_page(drawn()[0], tmp_path / "p.png", dots_per_inch=50)
    header = (tmp_path / "p.png").read_bytes()[16:24]
    assert (int.from_bytes(header[:4], "big"), int.from_bytes(header[4:], "big")) == (150, 100)


def test_an_axis_is_named_and_its_text_can_be_measured_before_it_is_saved():
    page, axis = drawn()
    label = axis.xaxis.label
    assert label.get_text() == "time [s]"
    assert label.get_window_extent(page.canvas.get_renderer()).width > 0.0
    assert axis.lines[0].get_color() == COLOURS["black"]
