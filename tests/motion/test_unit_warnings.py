"""A cycle whose forces are in kN, body weights or mN, torques in N·m or translations in m gets a warning; one in N,
N·mm and mm does not, nor one without load."""

import logging

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.motion.joint_cycle import scene_cycles
from casadi_contact.motion.load_cycle import write_cycle
from casadi_contact.motion.unit_warnings import (
    force_unit_warning,
    torque_unit_warning,
    translation_unit_warning,
    unit_warnings,
)
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.project import Project, reference_motion_cycles
from casadi_contact.project import samples as drawn_samples

SCALES = [
    (1.0, ""),
    (0.0, ""),
    (1e-3, "in kN or body weights?"),
    (1.0 / 750.0, "in kN or body weights?"),
    (1e3, "in mN"),
]


@pytest.mark.parametrize(("scale", "asked"), SCALES)
def test_forces_of_walking_in_another_unit_get_a_warning(scale, asked):
    wanted = {name: scale * curve if name[0] == "F" else curve for name, curve in reference_cycle().wanted().items()}
    said = force_unit_warning(cc.load_scene("knee"), wanted)
    assert asked in said
    assert bool(asked) == bool(said)


@pytest.mark.parametrize(
    ("force_n", "text"), [(0.00213, "0.0021 N"), (2.13, "2.1 N"), (21300, "21,000"), (1e6, "1,000,000 N")]
)
def test_the_force_is_written_as_people_write_it(force_n, text):
    said = force_unit_warning(cc.load_scene("knee"), {"Fy_med": -force_n * np.ones(3)})
    assert text in said
    assert "e+" not in said


def test_three_body_weights_on_a_hip_get_none():
    scene = cc.load_scene("hip")
    assert force_unit_warning(scene, scene_cycles(scene)[0].wanted()) == ""
    assert "in mN" in force_unit_warning(
        scene, {name: 1e3 * curve for name, curve in scene_cycles(scene)[0].wanted().items()}
    )


LEVER = np.linspace(-8.0, 12.0, 5)  # of a force of 500 N [mm]


@pytest.mark.parametrize(("scale", "asked"), [(1.0, ""), (1e-3, "in N·m?"), (1e-12, ""), (0.0, "")])
def test_torques_in_newton_metres_get_a_warning(scale, asked):
    said = torque_unit_warning({"Fy": np.full(5, -500.0), "Tx": scale * 500.0 * LEVER, "Tz": np.zeros(5)})
    assert asked in said
    assert bool(asked) == bool(said)


def test_torques_without_a_force_get_none():
    assert torque_unit_warning({"Tx": 0.5 * LEVER}) == ""


@pytest.mark.parametrize(("scale", "asked"), [(1.0, ""), (1e-3, "in m?"), (1e-15, ""), (0.0, "")])
def test_translations_in_metres_get_a_warning(scale, asked):
    said = translation_unit_warning({"tx": scale * LEVER, "tz": np.full(5, 3.0), "rz": 0.01 * LEVER})
    assert asked in said
    assert bool(asked) == bool(said)
    assert translation_unit_warning({"rz": 1e-6 * LEVER}) == "", "rotations are in rad"


def test_motions_that_scenes_bring_get_none():
    for name in ("knee", "hip", "glenohumeral", "patellofemoral", "planar_knee"):
        scene = cc.load_scene(name)
        for cycle in reference_motion_cycles(scene, []):
            assert unit_warnings(scene, cycle.wanted(), cycle.measured_pose()) == [], name


def test_it_is_told_before_poses_and_samples_are_looked_for(tmp_path, monkeypatch, caplog):
    """Samples around walking with a newton on each side would all be drawn, and nothing else be said."""
    walking = reference_cycle(frames=5)
    light = type(walking)(**{**vars(walking), "fy_med": 1e-3 * walking.fy_med, "fy_lat": 1e-3 * walking.fy_lat})
    write_cycle(light, tmp_path / "light.csv")

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawn_samples, "reference_motion", stop)
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        drawn_samples.sample(Project.open("knee", "quick", tmp_path / "out"), [tmp_path / "light.csv"])
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == ["cycle light"]
