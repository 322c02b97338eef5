"""Cycles of any joint: from a scene's harmonics and from CSV files with units in their columns."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.cycle import Cycle, read_cycle, scene_cycles, write_cycle
from casadi_contact.scenes.loading import scene_from_text
from casadi_contact.scenes.scene import Scene

JOINTS = ("hip", "patellofemoral", "glenohumeral")


def with_motion(**changes):
    tables = dict(cc.load_scene("hip").tables)
    return Scene.from_tables({**tables, "motion": {**tables["motion"], **changes}})


@pytest.mark.parametrize("name", JOINTS)
def test_ready_cycles_close_press_and_spread_about_their_mean(name):
    scene = cc.load_scene(name)
    cycles = scene_cycles(scene)
    assert len(cycles) == 10
    again = scene_cycles(scene)
    for k, cycle in enumerate(cycles):
        curves = {**cycle.pose, **cycle.loads}
        assert len(curves) == 6
        for key, curve in curves.items():
            assert curve[0] == pytest.approx(curve[-1], abs=1e-9)
            np.testing.assert_array_equal(curve, {**again[k].pose, **again[k].loads}[key])
        for normal in scene.normal_loads:
            forces = np.stack([cycle.loads[load] for load in normal.loads])
            pressed = np.linalg.norm(forces, axis=0) if normal.component is None else normal.sign * forces[0]
            assert pressed.min() > scene.boundary_load


def test_the_hips_mean_cycle_loads_it_with_about_two_body_weights():
    cycles = scene_cycles(with_motion(deviation=0.0))
    force = np.linalg.norm([cycles[0].loads[name] for name in ("Fx", "Fy", "Fz")], axis=0)
    assert 2.0 < force.max() / 750.0 < 2.5
    np.testing.assert_array_equal(cycles[0].loads["Fy"], cycles[1].loads["Fy"])


@pytest.mark.parametrize("name", [*JOINTS, "planar_knee"])
def test_a_motion_does_not_depend_on_the_loads_that_are_learned(name, tmp_path):
    whole = cc.load_scene(name)
    text = f'format = 1\nname = "fewer"\nlike = "{name}"\n[loads]\nnames = ["{whole.load_names[-1]}"]\n'
    fewer = scene_from_text(text)
    for cycle, as_whole in zip(scene_cycles(fewer), scene_cycles(whole), strict=True):
        assert list(cycle.loads) == list(as_whole.loads)
        for load, curve in cycle.loads.items():
            np.testing.assert_array_equal(curve, as_whole.loads[load])
    write_cycle(cycle, tmp_path / "cycle.csv")
    assert set(read_cycle(tmp_path / "cycle.csv", fewer).loads) == set(cycle.loads)


def test_a_cycle_comes_back_from_its_file(tmp_path):
    scene, path = cc.load_scene("hip"), tmp_path / "walk.csv"
    cycle = scene_cycles(scene)[0]
    write_cycle(cycle, path)
    assert path.read_text().startswith("time_s,")
    again = read_cycle(path, scene)
    assert again.name == "walk"
    for name, curve in {**cycle.pose, **cycle.loads}.items():
        np.testing.assert_array_equal({**again.pose, **again.loads}[name], curve)
    path.write_text("time_s,rz_rad\n0.0,0.1\n1.0,0.2\n")
    with pytest.raises(ValueError, match="no load"):
        read_cycle(path, scene)


def test_columns_are_converted_by_the_unit_in_their_name(tmp_path):
    (tmp_path / "cycle.csv").write_text("time_s,rz_deg,tx_m,Fy_kN,Tx_Nm\n0,90,0.002,0.9,5\n1,90,0.002,0.9,5\n")
    cycle = read_cycle(tmp_path / "cycle.csv", cc.load_scene("hip"))
    assert cycle.pose["rz"][0] == pytest.approx(np.pi / 2)
    assert (cycle.pose["tx"][0], cycle.loads["Fy"][0]) == pytest.approx((2.0, 900.0))


@pytest.mark.parametrize("header", ["rz_rad", "rz", "rz_grad", "Fy_BW", "Fx_kN"])
def test_angles_in_degrees_names_without_a_known_unit_and_a_second_column_are_refused(tmp_path, header):
    (tmp_path / "cycle.csv").write_text(f"time_s,Fx_N,{header}\n0.0,900,30\n0.1,900,30\n")
    with pytest.raises(ValueError, match=r"radians|unit|two"):
        read_cycle(tmp_path / "cycle.csv", cc.load_scene("hip"))


@pytest.mark.parametrize(
    ("time_s", "pose", "loads", "said"),
    [
        ([0.0, 1.0, 2.0], {}, {"Fy": [1.0, 2.0]}, "Fy"),
        ([0.0, 1.0], {"rx": [0.0, np.nan]}, {"Fy": [1.0, 2.0]}, "rx"),
        ([0.0, 1.0], {}, {"Fy": [1.0, 1e20]}, "row 2"),
        ([0.0, 1.0, 1.0], {}, {"Fy": [1.0, 2.0, 3.0]}, "rise"),
        ([0.0], {}, {"Fy": [1.0]}, "frames"),
    ],
)
def test_curves_that_are_no_cycle_are_refused_by_name(time_s, pose, loads, said):
    with pytest.raises(ValueError, match=said):
        Cycle("walk", time_s, pose, loads)
