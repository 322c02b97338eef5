"""Input of the muscle problem: CSV and OpenSim files give the same walk, wrong units and signs are refused."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.scenes.opensim import ColumnMap, Table, write_table
from problems.walks import at_times, example_walk, read_walk
from tests.support.muscle_files import write_walk

WALK = example_walk(frames=41)


@pytest.fixture
def files(tmp_path):
    """The example walk as CSV files: arguments of read_walk."""
    return write_walk(tmp_path, WALK)


def assert_same(walk, rtol):
    assert walk.muscles.names == WALK.muscles.names
    np.testing.assert_allclose(walk.rz, WALK.rz, rtol=rtol)
    np.testing.assert_allclose(walk.ry, WALK.ry, rtol=rtol)
    np.testing.assert_allclose(walk.lengths_m, WALK.lengths_m, rtol=rtol)
    for name in WALK.loads:
        np.testing.assert_allclose(walk.loads[name], WALK.loads[name], rtol=rtol, atol=1e-9)
        np.testing.assert_allclose(walk.arms[name], WALK.arms[name], rtol=rtol, atol=1e-9)


def test_csv_files_give_the_walk_they_were_written_from(files):
    walk = read_walk(**files)
    assert walk.name == "walk"
    assert_same(walk, rtol=0.0)
    np.testing.assert_array_equal(walk.velocities_m_per_s, WALK.velocities_m_per_s)


def test_opensim_files_give_the_same_walk(files, tmp_path):
    def write(name, curves, in_degrees=None):
        write_table(Table(name, {"time": WALK.time_s, **curves}, in_degrees), tmp_path / name)
        return tmp_path / name

    def by_muscle(table):
        """A MuscleAnalysis lists the whole body: muscles without parameters do not count."""
        return dict(zip((*WALK.muscles.names, "soleus"), (*table.T, table[:, 0]), strict=True))

    turns = {"knee_angle_r": -np.degrees(WALK.rz), "knee_rot_r": np.degrees(WALK.ry)}
    files["rotations"] = write("walk.mot", turns, in_degrees=True)
    files["inverse_dynamics"] = write("id.sto", WALK.loads)
    files["muscles"] = tmp_path
    write("walk_MuscleAnalysis_Length.sto", by_muscle(WALK.lengths_m))
    for name, arms in WALK.arms.items():
        write(f"walk_MuscleAnalysis_MomentArm_{name}.sto", by_muscle(arms))
    walk = read_walk(**files, maps=[ColumnMap.parse("knee_angle_r=-rz"), ColumnMap.parse("knee_rot_r=ry:deg")])
    assert_same(walk, rtol=1e-12)
    travelled = np.trapezoid(walk.velocities_m_per_s, walk.time_s, axis=0)
    np.testing.assert_allclose(travelled, WALK.lengths_m[-1] - WALK.lengths_m[0], atol=0.001)


def test_curves_that_end_before_inverse_dynamics_does_are_refused():
    curve = np.sin(WALK.time_s)[:, None]
    np.testing.assert_allclose(at_times("file", WALK.time_s, curve, WALK.time_s), curve)
    with pytest.raises(ValueError, match="times"):
        at_times("file", WALK.time_s[:20], curve[:20], WALK.time_s)


@pytest.mark.parametrize(
    ("which", "old", "new", "word"),
    [
        ("muscles", "\n3,semimem", "\n2,semimem", "semimem"),
        ("inverse_dynamics", "knee", "hip", "columns"),
        ("rotations", "flexion_rz_rad", "flexion", "flexion_rz_rad"),
        ("rotations", "\n0.0,", "\n9.0,", "rise"),
        ("parameters", "grac,140.0", "grac,-140.0", "grac"),
    ],
)
def test_a_fault_in_a_file_is_named(files, which, old, new, word):
    files[which].write_text(files[which].read_text().replace(old, new, -1 if old == "knee" else 1))
    with pytest.raises(ValueError, match=word):
        read_walk(**files)


@pytest.mark.parametrize(
    ("field", "factor", "names", "word"),
    [
        ("lengths_m", 1e3, (), "mm"),
        ("arms", 1e3, ("knee_flexion",), "unit"),
        ("arms", -1.0, ("knee_ty",), "sign"),
        ("velocities_m_per_s", -1.0, (), "sign"),
        ("loads", 1 / 736, ("knee_tx", "knee_ty", "knee_tz"), "unit"),
        ("rz", np.nan, (), "finite"),
    ],
)
def test_units_and_signs_that_no_knee_has_are_refused(field, factor, names, word):
    value = getattr(WALK, field)
    changed = {**value, **{n: factor * value[n] for n in names}} if names else factor * value
    with pytest.raises(ValueError, match=word):
        replace(WALK, **{field: changed})
