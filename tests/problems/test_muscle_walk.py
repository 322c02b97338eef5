"""Input of the muscle problem: CSV and OpenSim files give the same walk, faults are named."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.motion.columns import write_columns
from casadi_contact.motion.load_cycle import write_cycle
from casadi_contact.motion.opensim import ColumnMap, Table, write_table
from casadi_contact.motion.walking import reference_cycle
from problems.muscle_contact.example import example_walk
from problems.muscle_contact.given import measured_cycle
from problems.muscle_contact.walk import read_length_range, read_walk
from tests.support.muscle_files import write_walk
from tests.support.shared_data import shared_file

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
    # velocities come from the lengths: they move a muscle from its first length to its last
    travelled = np.trapezoid(walk.velocities_m_per_s, walk.time_s, axis=0)
    np.testing.assert_allclose(travelled, WALK.lengths_m[-1] - WALK.lengths_m[0], atol=0.001)


def drop_after(path, time_s):
    """Take the rows of a table after a time out of it."""
    lines = path.read_text().splitlines()
    separator = "," if path.suffix == ".csv" else "\t"
    lines = [line for line in lines if not line.startswith("nRows")]
    numbers = [line[:1].isdigit() and separator in line for line in lines]
    kept = [
        line for line, row in zip(lines, numbers, strict=True) if not row or float(line.split(separator)[0]) <= time_s
    ]
    path.write_text("\n".join(kept) + "\n")


def test_curves_that_end_before_inverse_dynamics_does_are_refused_with_both_ranges(files, tmp_path):
    """Rotations, lengths and arms alike: what is beyond their ends is not known, and was held or extrapolated."""
    by_muscle = {name: dict(zip(WALK.muscles.names, table.T, strict=True)) for name, table in WALK.arms.items()}
    curves = {"Length": dict(zip(WALK.muscles.names, WALK.lengths_m.T, strict=True))}
    curves |= {f"MomentArm_{name}": table for name, table in by_muscle.items()}
    tables = {name: tmp_path / f"walk_MuscleAnalysis_{name}.sto" for name in curves}
    for name, path in tables.items():
        write_table(Table(name, {"time": WALK.time_s, **curves[name]}), path)
    end, step = WALK.time_s[-1], WALK.time_s[1]  # 1.12 s in 41 frames
    said = r"from 0 to 0\.56\d* s, inverse dynamics from 0 to 1\.12\d* s: expected .* cut inverse dynamics"
    for path in (files["rotations"], tables["Length"], tables["MomentArm_knee_flexion"]):
        whole = path.read_text()
        drop_after(path, end - 0.5 * step)  # a step is what files are cut apart by
        read_walk(**{**files, "muscles": tmp_path})
        drop_after(path, 0.5 * end)
        with pytest.raises(ValueError, match=rf"{path.name} reaches {said}"):
            read_walk(**{**files, "muscles": tmp_path})
        path.write_text(whole)


def test_a_measured_cycle_that_lacks_the_end_of_the_walk_is_not_compared(tmp_path):
    cycle = reference_cycle(41)
    write_cycle(cycle, tmp_path / "measured.csv")
    assert len(measured_cycle(tmp_path / "measured.csv", WALK)) == 41
    drop_after(tmp_path / "measured.csv", 0.6 * cycle.time_s[-1])
    with pytest.raises(ValueError, match=r"measured.csv reaches from 0 to \S+ s, inverse dynamics from 0 to"):
        measured_cycle(tmp_path / "measured.csv", WALK)


def drop(path, text):
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith(text)) + "\n")


def swap(path, old, new):
    path.write_text(path.read_text().replace(old, new, 1))


@pytest.mark.parametrize(
    ("which", "harm", "said"),
    [
        ("muscles", lambda p: drop(p, "3,semimem"), r"muscles.csv lacks muscle semimem at frame 3 of 41"),
        ("muscles", lambda p: swap(p, "\n40,vasmed", "\n39,vasmed"), "muscle vasmed at frame 39 is there twice"),
        (
            "muscles",
            lambda p: swap(p, "\n40,vasmed", "\n40.4,vasmed"),
            "frame is 40.4, expected a whole number",
        ),
        (
            "muscles",
            lambda p: swap(p, "\n0,", "\n-1,"),
            "muscles.csv line 2: frame is -1, expected",
        ),
        ("muscles", lambda p: swap(p, "length_m", "length"), "lacks the column length_m; it has frame, muscle, length"),
        ("muscles", lambda p: p.write_text(p.read_text() + "0,x\n"), r"line 535: got 2 values, expected \d+"),
        ("inverse_dynamics", lambda p: p.write_text(p.read_text().replace("knee", "hip")), "has none of the columns"),
        ("inverse_dynamics", lambda p: swap(p, "\n0.0,", "\n0.0,nan,#"), "line 2"),
        ("inverse_dynamics", lambda p: swap(p, "time_s", "t"), "lacks the column time_s"),
        (
            "rotations",
            lambda p: swap(p, "flexion_rz_rad", "flexion"),
            "lacks the columns flexion_rz_rad; it has",
        ),
        ("rotations", lambda p: swap(p, "\n0.0,", "\n9.0,"), "time does not rise at frame 1, "),
        ("parameters", lambda p: swap(p, "grac,140.0", "grac,-140.0"), "parameters.csv: max_isometric_force_n of grac"),
        ("parameters", lambda p: swap(p, "grac,140.0", "grac,x"), "max_isometric_force_N: got 'x', expected a number"),
        (
            "parameters",
            lambda p: (drop(p, "vaslat"), drop(p, "vasmed")),
            "muscles.csv has the muscles vaslat, vasmed, of which the parameters file has no row, .*: add their rows",
        ),
        ("parameters", lambda p: p.unlink(), "parameters.csv does not exist"),
        ("muscles", lambda p: p.write_bytes(b"\xff\xfe"), "is not a CSV text file"),
    ],
)
def test_a_fault_is_named(files, which, harm, said):
    harm(files[which])
    with pytest.raises((ValueError, FileNotFoundError), match=said):
        read_walk(**files)


def test_columns_that_are_not_asked_for_may_hold_text(files):
    for which in ("rotations", "inverse_dynamics"):
        header, *rows = files[which].read_text().splitlines()
        files[which].write_text("\n".join([f"{header},remark", *(f"{row},left leg" for row in rows)]) + "\n")
    assert_same(read_walk(**files), rtol=0.0)


def test_rotations_in_degrees_are_told(files):
    turns = {"time_s": WALK.time_s, "flexion_rz_rad": np.degrees(WALK.rz), "rotation_ry_rad": np.degrees(WALK.ry)}
    write_columns(files["rotations"], turns)
    with pytest.raises(ValueError, match=r"flexion_rz_rad reaches \S+, expected radians: is it in degrees\?"):
        read_walk(**files)


def test_the_range_of_lengths_of_a_further_cycle_is_read_alone(files):
    expected = [WALK.lengths_m.min(axis=0), WALK.lengths_m.max(axis=0)]
    np.testing.assert_allclose(read_length_range(files["muscles"], WALK.muscles.names), expected)
    with pytest.raises(ValueError, match=r"muscles.csv lacks the muscles soleus"):
        read_length_range(files["muscles"], (*WALK.muscles.names, "soleus"))
    swap(files["muscles"], "0,bflh,0.", "0,bflh,2990.")
    with pytest.raises(ValueError, match=r"muscles.csv: bflh is \S+ to 2990\S* m long, .* are lengths in mm"):
        read_length_range(files["muscles"], WALK.muscles.names)


def test_a_walk_that_does_not_fit_together_is_refused():
    with pytest.raises(ValueError, match=r"lengths have shape \(41, 12\), expected \(41, 13\)"):
        replace(WALK, lengths_m=WALK.lengths_m[:, 1:])
    with pytest.raises(ValueError, match="rz hold NaN at frame 0"):
        replace(WALK, rz=np.full(41, np.nan))
    with pytest.raises(ValueError, match="coordinates knee_ty lack loads or arms"):
        replace(WALK, loads={name: curve for name, curve in WALK.loads.items() if name != "knee_ty"})
    twice = WALK.time_s.copy()
    twice[8] = twice[7]
    with pytest.raises(ValueError, match=r"time does not rise at frame 8, .* expected rows .*, and none twice"):
        replace(WALK, time_s=twice)


def test_a_measured_walk_is_read():
    names = ("og1_loads", "og1_inverse_dynamics", "og1_muscles", "muscle_parameters")
    walk = read_walk(*(shared_file(f"data/jw/{name}.csv") for name in names))
    assert (walk.name, len(walk), len(walk.muscles.names)) == ("og1", 101, 13)
    # the vasti lengthen as the knee bends: arm = -dlength/drz, times and frames of the files belong together
    muscle = walk.muscles.names.index("vasint")
    slope = np.gradient(walk.lengths_m[:, muscle]) / np.gradient(walk.rz)
    moving = np.abs(np.gradient(walk.rz)) > 0.02
    difference = -slope[moving] - walk.arms["knee_flexion"][moving, muscle]
    assert np.median(np.abs(difference)) < 0.003  # m; the femur's translations change lengths too


def scaled(field, factor, *names):
    """The walk with a table, or the curves of some coordinates, times a factor."""
    value = getattr(WALK, field)
    if names:
        return replace(WALK, **{field: {**value, **{name: factor * value[name] for name in names}}})
    return replace(WALK, **{field: factor * value})


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (
            lambda: scaled("arms", 1e3, "knee_flexion"),
            r"arm of semiten about knee_flexion is -50 .* at most 0.3: .* mm",
        ),
        (lambda: scaled("arms", -1.0, "knee_flexion"), "shorten that lengthen by their arms .* turn the sign"),
        (lambda: scaled("rz", -1.0), "shorten that lengthen by their arms .* or of rz"),
        (lambda: scaled("arms", -1.0, "knee_ty"), r"about knee_ty are \+0.96 in the mean, expected negative"),
        (
            lambda: scaled("arms", -1.0, "knee_adduction"),
            "about knee_adduction are .* of .*grac.* and .* of bflh.*: turn their sign, or mirror a left knee",
        ),
        (lambda: scaled("arms", -1.0, "knee_rotation"), "about knee_rotation are .* in the mean of bflh, bfsh and"),
        (lambda: scaled("velocities_m_per_s", -1.0), r"of bflh are -1 times dlength/dt .* turn their sign"),
        (lambda: scaled("velocities_m_per_s", 1e3), "are 1e.03 times dlength/dt .* give m/s"),
        (lambda: scaled("lengths_m", 1e3), "expected more than 0 and at most 2 m: are lengths in mm"),
        (lambda: scaled("loads", 1 / 736, "knee_tx", "knee_ty", "knee_tz"), "reaches 0.72 in .* Multiply by it"),
        (
            lambda: scaled("loads", 1 / 75, "knee_adduction", "knee_rotation", "knee_flexion"),
            "reaches 0.29 in knee_adduction, knee_rotation, knee_flexion, expected Nm of a body: is it over",
        ),
        (lambda: scaled("loads", 1e3, "knee_adduction"), "reaches 22000 .* at most 1000: is it in N·mm"),
        (
            lambda: replace(WALK.muscles, pennation_rad=np.degrees(WALK.muscles.pennation_rad)),
            "pennation_rad of bflh is 11.4592, expected 0 to 1.57 rad: is it in degrees",
        ),
        (
            lambda: replace(WALK.muscles, optimal_fibre_length_m=1e3 * WALK.muscles.optimal_fibre_length_m),
            "optimal_fibre_length_m of bflh is 100, expected more than 0 and less than 1 m: is it in mm",
        ),
    ],
)
def test_units_and_signs_that_no_knee_has_are_refused_with_the_cure(harm, said):
    with pytest.raises(ValueError, match=said):
        harm()


def test_signs_of_adduction_arms_are_told_by_names_of_other_leg_models_and_by_no_others():
    names = WALK.muscles.names
    opensim = {"gasmed": "med_gas_r", "gaslat": "lat_gas_r", "bflh": "bifemlh_r", "bfsh": "bifemsh_r", "sart": "sar_r"}
    others = [replace(WALK.muscles, names=tuple(opensim.get(name, name) for name in names))]
    others.append(replace(WALK.muscles, names=tuple(f"muscle {k}" for k in range(len(names)))))
    turned = {**WALK.arms, "knee_adduction": -WALK.arms["knee_adduction"]}
    with pytest.raises(ValueError, match=r"mean of med_gas_r, .* of bifemlh_r"):
        replace(WALK, arms=turned, muscles=others[0])
    replace(WALK, muscles=others[0])
    replace(WALK, arms=turned, muscles=others[1])


def test_a_single_arm_against_its_muscle_s_lengths_is_doubted():
    arms = WALK.arms["knee_flexion"].copy()
    arms[:, WALK.muscles.names.index("vaslat")] *= -1.0
    with pytest.warns(RuntimeWarning, match="vaslat shortens where its arm about knee_flexion says that it lengthens"):
        replace(WALK, arms={**WALK.arms, "knee_flexion": arms})


def test_a_leg_that_hangs_in_stance_is_doubted():
    with pytest.warns(RuntimeWarning, match=r"knee_ty pulls the knee apart by up to 5\d\d N .* turn the signs"):
        scaled("loads", -1.0, *WALK.loads)


@pytest.mark.filterwarnings("error")
def test_swing_alone_is_not_doubted_though_it_pulls():
    swing = np.flatnonzero(WALK.loads["knee_ty"] < 0.0)
    replace(
        WALK,
        **{name: getattr(WALK, name)[swing] for name in ("time_s", "rz", "ry", "lengths_m", "velocities_m_per_s")},
        **{name: {key: part[swing] for key, part in getattr(WALK, name).items()} for name in ("loads", "arms")},
    )


def test_true_velocities_at_few_frames_are_taken_though_differences_of_lengths_are_others():
    fine = example_walk(frames=201)
    few = np.linspace(0, 200, 6, dtype=int)
    arrays = {name: getattr(fine, name)[few] for name in ("time_s", "rz", "ry", "lengths_m", "velocities_m_per_s")}
    rates = np.gradient(arrays["lengths_m"], arrays["time_s"], axis=0)
    assert np.corrcoef(rates[:, 0], arrays["velocities_m_per_s"][:, 0])[0, 1] < 0.5, "frames tell the rates"
    replace(
        fine,
        **arrays,
        loads={name: curve[few] for name, curve in fine.loads.items()},
        arms={name: table[few] for name, table in fine.arms.items()},
    )


def test_muscles_without_velocity_and_a_leg_without_load_are_taken():
    scaled("velocities_m_per_s", 0.0)
    scaled("loads", 0.0, *WALK.loads)
