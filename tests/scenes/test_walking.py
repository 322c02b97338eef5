"""Measured cycles and the built-in reference motion."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.scenes.cycle import KNEE_COLUMNS, read_cycle
from casadi_contact.scenes.walking import reference_cycle, reference_cycles
from tests.support.shared_data import shared_file

GOOD = dict(zip(("time_s", *KNEE_COLUMNS), (0.0, -0.2, 0.01, -500, -300, 4, 6), strict=True))


def written(path, second):
    """A file of two rows, columns in another order and others beside them."""
    rows = [dict(row, comment="") for row in (GOOD, {**GOOD, "time_s": 0.5, **second})]
    lines = [list(reversed(rows[0])), *(reversed(row.values()) for row in rows)]
    path.write_text("\n".join(",".join(map(str, line)) for line in lines) + "\n")
    return path


def test_a_knee_s_cycle_is_read_by_column_name_in_any_order(tmp_path):
    cycle = read_cycle(written(tmp_path / "walk.csv", {}))
    assert cycle.name == "walk"
    assert cycle.pose["rz"].tolist() == [-0.2, -0.2]
    assert cycle.percent.tolist() == [0.0, 100.0]
    targets = cycle.targets()
    assert targets["Tz"][0] / -800.0 == pytest.approx(4.0)
    assert -targets["Tx"][0] / -800.0 == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ({"rotation_ry_rad": "nan"}, "line 3, rotation_ry_rad: got nan, expected a finite number"),
        ({"time_s": -1.0}, "time does not rise at frame 1"),
        ({"Fy_lat_N": 20.0}, "Fy_lat is 20 N at frame 1, expected compression"),
        ({"flexion_rz_rad": -60.0}, "rz reaches 60, expected radians"),
    ],
)
def test_bad_rows_are_named_by_file_line_and_column(tmp_path, second, said):
    path = written(tmp_path / "bad.csv", second)
    with pytest.raises(ValueError, match=said) as caught:
        read_cycle(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("renamed", "said"), [({"cop_ml_mm": "cop_mm"}, "lacks the columns cop_ml_mm"), ({"comment": "tx_mm"}, "beside")]
)
def test_a_knee_s_own_columns_are_complete_and_alone(tmp_path, renamed, said):
    path = written(tmp_path / "walk.csv", {})
    for old, new in renamed.items():
        path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=said):
        read_cycle(path)


def test_reference_cycles_are_seeded_push_and_share_one_rotation_curve():
    cycles = reference_cycles()
    assert len(cycles) == 14
    for a, b in zip(cycles, reference_cycles(), strict=True):
        np.testing.assert_array_equal(a.loads["Fy_med"], b.loads["Fy_med"])
        np.testing.assert_array_equal(a.pose["ry"], cycles[0].pose["ry"])
        assert max(force.max() for force in a.loads.values()) < -20.0
    for other in (reference_cycles(seed=1)[0], cycles[1]):
        assert not np.array_equal(cycles[0].loads["Fy_med"], other.loads["Fy_med"])


def test_the_mean_cycle_is_that_of_the_measured_cycles():
    mean = reference_cycle()
    for k in range(1, 5):
        measured = read_cycle(shared_file(f"data/jw/og{k}_loads.csv"))
        off = np.interp(mean.percent, measured.percent, measured.loads["Fy_med"]) - mean.loads["Fy_med"]
        assert np.sqrt(np.mean(off**2)) < 150.0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda centre, forces: (0.001 * centre, forces), "unit m"),
        (lambda centre, forces: (-centre, forces), "sign"),
        (lambda centre, forces: (centre, dict(zip(forces, reversed(forces.values()), strict=True))), "sides"),
    ],
)
def test_a_centre_of_pressure_that_contradicts_the_forces_is_refused(changed, said):
    cycle = reference_cycle()
    centre, forces = changed(cycle.centres["cop_ml"], cycle.loads)
    with pytest.raises(ValueError, match=said):
        replace(cycle, loads=forces, centres={**cycle.centres, "cop_ml": centre})
    moved = replace(cycle, centres={**cycle.centres, "cop_ml": cycle.centres["cop_ml"] + 8.0})
    assert moved.centres["cop_ml"].max() > 8.0, "another origin is allowed"
