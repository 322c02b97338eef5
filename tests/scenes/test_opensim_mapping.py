"""Columns as curves: units, signs, and back."""

import subprocess
import sys

import numpy as np
import pytest

from casadi_contact.scenes.joint_cycle import read_joint_cycle
from casadi_contact.scenes.load_cycle import read_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.opensim.mapping import ColumnMap, loads_table, mapped_curves, poses_table
from casadi_contact.scenes.opensim.table import Table, read_opensim_table, write_table
from casadi_contact.scenes.pose_file import read_poses
from casadi_contact.scenes.walking import reference_cycle
from tests.support.shared_data import shared_file

TABLE = Table("walk", {"time": [0.0, 1.0], "knee": [0.0, 90.0], "ty": [0.02, 0.03], "F": [1.0, 2.0]}, in_degrees=True)


def curve(text):
    return ColumnMap.parse(text).curve(TABLE)


def test_units_and_signs():
    np.testing.assert_allclose(curve("knee=-rz"), [0.0, -np.pi / 2.0])  # inDegrees=yes
    np.testing.assert_allclose(curve("knee=rz:rad"), [0.0, 90.0])
    np.testing.assert_allclose(curve("ty=ty"), [20.0, 30.0])  # metres
    np.testing.assert_allclose(curve("ty=cop_ap:mm"), [0.02, 0.03])
    np.testing.assert_allclose(curve("F=-Fy_med:kN"), [-1000.0, -2000.0])
    np.testing.assert_allclose(curve("F=Tz"), [1000.0, 2000.0])
    with_equals = Table("walk", {"time": [0.0], "a=b": [1.0]})
    assert ColumnMap.parse("a=b=Tz:Nmm").curve(with_equals) == [1.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("knee", "is not understood, expected COLUMN=NAME"),
        ("knee=rz:", "is not understood"),
        ("knee=+-rz", "is not understood"),
        ("knee=--rz", "is not understood"),
        ("knee=flexion", "unknown quantity 'flexion', expected one of tx, ty"),
        ("knee=rz:mm", "unit 'mm' does not suit rz, expected one of rad, deg"),
        ("hip=rz", "table 'walk' has no column 'hip'; it has time, knee"),
    ],
)
def test_a_map_that_cannot_be_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        curve(text)
    with pytest.raises(ValueError, match="rz is mapped twice"):
        mapped_curves(TABLE, [ColumnMap("knee", "rz"), ColumnMap("F", "rz")])


def test_results_come_back_from_their_opensim_table(tmp_path):
    poses = np.random.default_rng(1).normal(size=(4, 6))
    write_table(poses_table(np.arange(4.0), poses, "poses"), tmp_path / "poses.sto")
    table = read_opensim_table(tmp_path / "poses.sto")
    back = mapped_curves(table, [ColumnMap(name, name) for name in ("tx", "ry")])
    np.testing.assert_allclose(back["tx"], poses[:, 0], rtol=1e-15)
    np.testing.assert_array_equal(back["ry"], poses[:, 4])
    loads = loads_table(np.arange(4.0), poses[:, :2], ("Fy_med", "Tx"), "loads")
    np.testing.assert_allclose(1000.0 * loads.column("Tx"), poses[:, 1], rtol=1e-15)


def cycle_command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "casadi_contact.cli.main", "cycle", *map(str, arguments)], capture_output=True, text=True
    )


def test_the_command_writes_the_cycle_that_a_file_holds(tmp_path):
    cycle = reference_cycle()
    fy = cycle.fy_med + cycle.fy_lat
    columns = {
        "time": cycle.time_s,
        "knee_angle_r": np.degrees(-cycle.rz),
        "knee_rot_r": np.degrees(cycle.ry),
        "tibia_Fy_m": cycle.fy_med,
        "tibia_Fy_l": cycle.fy_lat,
        "cop_x": 1e-3 * cycle.cop_ap_mm,
        "tibia_Tx": -1e-3 * cycle.cop_ml_mm * fy,
    }
    write_table(Table("walk", columns, in_degrees=True), tmp_path / "walk.mot")
    names = ("knee_angle_r=-rz:deg", "knee_rot_r=ry", "tibia_Fy_m=Fy_med:N", "tibia_Fy_l=Fy_lat", "cop_x=cop_ap:m")
    maps = [word for name in (*names, "tibia_Tx=Tx:Nm") for word in ("--map", name)]
    done = cycle_command(tmp_path / "walk.mot", *maps, "--out", tmp_path / "walk.csv")
    assert done.returncode == 0, done.stderr
    back = read_cycle(tmp_path / "walk.csv")
    for key in ("time_s", "rz", "ry", "fy_med", "fy_lat", "cop_ap_mm", "cop_ml_mm"):
        np.testing.assert_allclose(getattr(back, key), getattr(cycle, key), rtol=1e-12, atol=1e-12)
    less = cycle_command(tmp_path / "walk.mot", *maps[:6], "--out", tmp_path / "less.csv")
    assert less.returncode == 1
    assert "needs the curves Fy_lat, cop_ap (or Tz), cop_ml (or Tx)" in less.stderr
    assert len(less.stderr.strip().splitlines()) == 1


POSE_MAPS = (
    "knee_ant_r=tx:m",
    "knee_sup_r=ty:m",
    "knee_lat_r=tz",
    "knee_flex_r=rx:rad",
    "knee_add_r=ry",
    "knee_rot_r=rz",
)


def mapped(names):
    return [word for name in names for word in ("--map", name)]


def test_the_command_writes_the_poses_that_a_file_holds(tmp_path):
    poses = np.random.default_rng(4).normal(size=(3, 6))
    source = poses_table(np.arange(3.0), poses, "poses")
    labels = [name.split("=")[0] for name in POSE_MAPS]
    columns = dict(zip(["time", *labels], source.columns.values(), strict=True))
    write_table(Table("walk", columns), tmp_path / "walk.sto")
    done = cycle_command(tmp_path / "walk.sto", *mapped(POSE_MAPS), "--out", tmp_path / "poses.csv")
    assert done.returncode == 0, done.stderr
    assert "3 poses in" in done.stdout
    np.testing.assert_allclose(read_poses(tmp_path / "poses.csv"), poses, rtol=1e-15)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("F=Fy_med", "ty=ty"), "a load cycle has no place for ty, expected time, rz, ry, Fy_med"),
        (("knee=rz", "ty=ty"), "without loads these are poses, which need the curves tx, tz, rx, ry; there are time"),
    ],
)
def test_a_mixture_that_is_neither_poses_nor_a_load_cycle_is_refused_in_one_line(tmp_path, names, said):
    write_table(TABLE, tmp_path / "walk.mot")
    done = cycle_command(tmp_path / "walk.mot", *mapped(names), "--out", tmp_path / "out.csv")
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out.csv").exists()


def test_a_cycle_of_another_joint_is_that_of_its_scene(tmp_path):
    columns = {"time": np.arange(3.0), "flexion": np.array([10.0, 20.0, 30.0]), "force": np.array([0.1, 0.9, 0.4])}
    write_table(Table("walk", columns, in_degrees=True), tmp_path / "walk.mot")
    maps = ("flexion=-rz", "force=Fy:kN")
    done = cycle_command(tmp_path / "walk.mot", *mapped(maps), "--scene", "hip", "--out", tmp_path / "hip.csv")
    assert done.returncode == 0, done.stderr
    assert "cycle of 3 frames" in done.stdout
    cycle = read_joint_cycle(tmp_path / "hip.csv", load_scene("hip"))
    np.testing.assert_allclose(cycle.pose["rz"], -np.radians([10.0, 20.0, 30.0]), rtol=1e-15)
    np.testing.assert_allclose(cycle.loads["Fy"], [100.0, 900.0, 400.0], rtol=1e-15)


def test_measured_poses_become_a_pose_file(tmp_path):
    file = shared_file("data/dm_tka/fluoroscopic_gait.sto")
    done = cycle_command(file, *mapped(POSE_MAPS), "--out", tmp_path / "poses.csv")
    assert done.returncode == 0, done.stderr
    poses = read_poses(tmp_path / "poses.csv")
    assert poses.shape == (101, 6)
    np.testing.assert_allclose(poses[0], [-7.4, 41.7, -1.0, 0.0063, 0.0037, -0.0943], atol=1e-12)
