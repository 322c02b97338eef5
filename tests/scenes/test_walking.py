"""Measured cycles and the built-in reference motion."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.scenes.load_cycle import COLUMNS, read_cycle
from casadi_contact.scenes.walking import reference_cycle, reference_cycles
from tests.support.shared_data import shared_file


def write(path, rows):
    lines = [["comment", *reversed(COLUMNS.values())], *rows]
    path.write_text("\n".join(",".join(map(str, row)) for row in lines) + "\n")
    return path


def good_row(time):
    values = {"time_s": time, "rz": -0.2, "ry": 0.01, "fy_med": -500, "fy_lat": -300, "cop_ap_mm": 4, "cop_ml_mm": 6}
    return ["", *(values[key] for key in reversed(COLUMNS))]


def test_a_cycle_is_read_by_column_name_in_any_order(tmp_path):
    cycle = read_cycle(write(tmp_path / "walk.csv", [good_row(0.0), good_row(0.5)]))
    assert cycle.name == "walk"
    assert cycle.rz.tolist() == [-0.2, -0.2]
    assert cycle.percent.tolist() == [0.0, 100.0]
    targets = cycle.targets()
    assert targets["Tz"][0] / -800.0 == pytest.approx(4.0)
    assert -targets["Tx"][0] / -800.0 == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("ry", "nan", "line 3, rotation_ry_rad: got nan, expected a finite number"),
        ("time_s", -1.0, "time does not rise at frame 1"),
        ("fy_lat", 20.0, "Fy_lat_N is 20 at frame 1, expected compression"),
        ("rz", -60.0, "rz reaches 60, expected radians"),
    ],
)
def test_bad_rows_are_named_by_file_line_and_column(tmp_path, column, value, said):
    row = good_row(0.5)
    row[1 + list(reversed(COLUMNS)).index(column)] = value
    path = write(tmp_path / "bad.csv", [good_row(0.0), row])
    with pytest.raises(ValueError, match=said) as caught:
        read_cycle(path)
    assert str(path) in str(caught.value)


def test_reference_cycles_are_seeded_push_and_share_one_rotation_curve():
    cycles = reference_cycles()
    assert len(cycles) == 14
    for a, b in zip(cycles, reference_cycles(), strict=True):
        np.testing.assert_array_equal(a.fy_med, b.fy_med)
        np.testing.assert_array_equal(a.ry, cycles[0].ry)
        assert max(a.fy_med.max(), a.fy_lat.max()) < -20.0
    assert not np.array_equal(cycles[0].fy_med, reference_cycles(seed=1)[0].fy_med)
    assert not np.array_equal(cycles[0].fy_med, cycles[1].fy_med)


def test_the_mean_cycle_is_that_of_the_measured_cycles():
    mean = reference_cycle()
    for k in range(1, 5):
        measured = read_cycle(shared_file(f"data/jw/og{k}_loads.csv"))
        off = np.interp(mean.percent, measured.percent, measured.fy_med) - mean.fy_med
        assert np.sqrt(np.mean(off**2)) < 150.0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda c: {"cop_ml_mm": 0.001 * c.cop_ml_mm}, "unit m"),
        (lambda c: {"cop_ml_mm": -c.cop_ml_mm}, "sign"),
        (lambda c: {"fy_med": c.fy_lat, "fy_lat": c.fy_med}, "sides"),
    ],
)
def test_a_centre_of_pressure_that_contradicts_the_forces_is_refused(changed, said):
    cycle = reference_cycle()
    with pytest.raises(ValueError, match=said):
        replace(cycle, **changed(cycle))
    assert replace(cycle, cop_ml_mm=cycle.cop_ml_mm + 8.0).cop_ml_mm.max() > 8.0, "another origin is allowed"
