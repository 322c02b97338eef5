"""Columns as curves: units, signs, and back."""

import numpy as np
import pytest

from casadi_contact.cli.scene_commands import cycle
from casadi_contact.scenes.joint_cycle import read_joint_cycle
from casadi_contact.scenes.load_cycle import read_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.opensim import (
    ColumnMap,
    Table,
    mapped_curves,
    write_table,
)
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


def written(folder, table, *maps, scene=None):
    """The CSV file that the command makes of a table, or of a file."""
    file = folder / "walk.mot"
    if isinstance(table, Table):
        write_table(table, file)
    cycle(file if isinstance(table, Table) else table, list(maps), folder / "out.csv", scene)
    return folder / "out.csv"


def test_the_command_writes_the_cycle_that_a_file_holds(tmp_path):
    walk = reference_cycle()
    columns = {
        "time": walk.time_s,
        "knee_angle_r": np.degrees(-walk.rz),
        "knee_rot_r": np.degrees(walk.ry),
        "tibia_Fy_m": walk.fy_med,
        "tibia_Fy_l": walk.fy_lat,
        "cop_x": 1e-3 * walk.cop_ap_mm,
        "tibia_Tx": -1e-3 * walk.cop_ml_mm * (walk.fy_med + walk.fy_lat),
    }
    table = Table("walk", columns, in_degrees=True)
    maps = ("knee_angle_r=-rz:deg", "knee_rot_r=ry", "tibia_Fy_m=Fy_med:N", "tibia_Fy_l=Fy_lat", "cop_x=cop_ap:m")
    back = read_cycle(written(tmp_path, table, *maps, "tibia_Tx=Tx:Nm"))
    for key in ("time_s", "rz", "ry", "fy_med", "fy_lat", "cop_ap_mm", "cop_ml_mm"):
        np.testing.assert_allclose(getattr(back, key), getattr(walk, key), rtol=1e-12, atol=1e-12)
    with pytest.raises(ValueError, match="needs the curves"):
        written(tmp_path, table, *maps[:3])


@pytest.mark.parametrize(
    ("names", "said"), [(("F=Fy_med", "ty=ty"), "needs the curves"), (("knee=rz", "ty=ty"), "poses")]
)
def test_a_mixture_that_is_neither_poses_nor_a_load_cycle_is_refused(tmp_path, names, said):
    with pytest.raises(ValueError, match=said):
        written(tmp_path, TABLE, *names)
    assert not (tmp_path / "out.csv").exists()


def test_a_cycle_of_another_joint_is_that_of_its_scene(tmp_path):
    columns = {"time": np.arange(3.0), "flexion": np.array([10.0, 20.0, 30.0]), "force": np.array([0.1, 0.9, 0.4])}
    path = written(tmp_path, Table("walk", columns, in_degrees=True), "flexion=-rz", "force=Fy:kN", scene="hip")
    back = read_joint_cycle(path, load_scene("hip"))
    np.testing.assert_allclose(back.pose["rz"], -np.radians([10.0, 20.0, 30.0]), rtol=1e-15)
    np.testing.assert_allclose(back.loads["Fy"], [100.0, 900.0, 400.0], rtol=1e-15)


def test_measured_poses_become_a_pose_file(tmp_path):
    labels = ("knee_ant_r=tx:m", "knee_sup_r=ty:m", "knee_lat_r=tz", "knee_flex_r=rx:rad", "knee_add_r=ry")
    poses = read_poses(written(tmp_path, shared_file("data/dm_tka/fluoroscopic_gait.sto"), *labels, "knee_rot_r=rz"))
    assert poses.shape == (101, 6)
    np.testing.assert_allclose(poses[0], [-7.4, 41.7, -1.0, 0.0063, 0.0037, -0.0943], atol=1e-12)
