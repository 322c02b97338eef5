"""A quantity's name says what it measures; units, columns, labels, tables and comparisons follow from that."""

import itertools
import math

import numpy as np
import pytest

from casadi_contact.core.quantities import KINDS, format_above_limit, newton_scales, quantity, three_digits, two_digits
from casadi_contact.scenes.opensim import ColumnMap, renamed_table

LOADS = ("Fy_med", "Tz", "peak_pressure_med", "contact_area")  # an implant's outputs beyond forces and torques


@pytest.mark.parametrize(
    ("name", "kind", "unit", "column", "patch"),
    [
        ("Fy_med", "force", "N", "Fy_med_N", "med"),
        ("F", "force", "N", "F_N", ""),
        ("Tx", "torque", "N·mm", "Tx_Nmm", ""),
        ("peak_pressure_lat", "pressure", "MPa", "peak_pressure_lat_MPa", "lat"),
        ("contact_area_med_2", "area", "mm²", "contact_area_med_2_mm2", "med_2"),
        ("rz", "angle", "rad", "rz_rad", ""),
        ("cop_ap", "length", "mm", "cop_ap_mm", ""),
        ("penetration_med", "length", "mm", "penetration_med_mm", "med"),
    ],
)
def test_a_name_says_kind_unit_column_and_patch(name, kind, unit, column, patch):
    found = quantity(name)
    assert (found.name, found.kind.name, found.unit, found.column, found.patch) == (name, kind, unit, column, patch)
    assert found.label == f"{name} [{unit}]"


def test_no_name_is_read_in_two_ways():
    assert not [pair for pair in itertools.permutations(KINDS, 2) if pair[0].startswith(f"{pair[1]}_")]


@pytest.mark.parametrize("name", ["flexion", "Fy_", "", "pressure", "fy_med"])
def test_a_name_that_measures_nothing_is_refused_with_those_that_do(name):
    with pytest.raises(ValueError, match="peak_pressure"):
        quantity(name)


def test_forces_and_torques_compare_by_a_lever_and_nothing_else_does():
    np.testing.assert_array_equal(newton_scales(("Fx", "Tz", "Fy_med"), 25.0), [1.0, 25.0, 1.0])
    with pytest.raises(ValueError, match="peak_pressure_med"):
        newton_scales(LOADS, 25.0)


def test_opensim_tables_hold_pressures_in_pascal_and_areas_in_square_metres():
    curves = dict(zip(("time", *LOADS), np.array([[0.0, 1.0, 1000.0, 2.0, 50.0]]).T, strict=True))
    table = renamed_table(curves, [ColumnMap(name, name) for name in LOADS], "contact")
    assert [float(table.column(name)[0]) for name in LOADS] == pytest.approx([1.0, 1.0, 2e6, 5e-5])
    assert ColumnMap("peak_pressure_med", "peak_pressure_med").curve(table)[0] == pytest.approx(2.0)
    with pytest.raises(ValueError, match="contact_area"):
        ColumnMap("area", "contact_area", unit="N")


@pytest.mark.parametrize(("value", "limit", "text"), [
    (2.0, 1.5, "2"), (1.50342, 1.5, "1.503"), (1.5000001, 1.5, "1.5000001"), (1234.6, 1234.5, "1235"),
    (1.50342, 2.0, "1.5"), (1.5, 1.5, "1.5"), (1823.4, 200.0, "1820"), (math.inf, 1.5, "inf"), (math.nan, 1.5, "nan"),
])  # fmt: skip
def test_a_number_above_a_limit_is_told_from_it(value, limit, text):
    assert format_above_limit(value, limit) == text


@pytest.mark.parametrize("value", [1.234e-4, 0.0567, 0.94, 9.96, 27.4, 99.6, 101.0, 184.0, 1260.0, -56789.0, 9.4e5])
def test_two_and_three_digits_of_what_people_measure_have_no_exponent(value):
    for text, share in ((two_digits(value), 0.05), (three_digits(value), 0.005)):
        assert set(text) <= set("-.0123456789")
        assert abs(float(text) - value) <= share * 10.0 ** math.floor(math.log10(abs(value)))
