"""Cycles with the signs of another knee, or of forces on the other body get a warning, those of the joint get none."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.scenes.joint_cycle import scene_cycles
from casadi_contact.scenes.walking import reference_cycle
from problems.pose_estimation.problem import measured_pose, wanted_loads
from problems.pose_estimation.sign_warnings import sign_warnings
from tests.support.asked import asked_before_solving

WALK = reference_cycle(frames=21)


def warnings(cycle, name="knee"):
    scene = cc.load_scene(name)
    return sign_warnings(wanted_loads(scene, cycle), measured_pose(scene, cycle), own_model(scene))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ""),
        ({"ry": -WALK.ry, "cop_ml_mm": -WALK.cop_ml_mm}, "left knee that was not mirrored"),
        ({"fy_med": WALK.fy_lat, "fy_lat": WALK.fy_med}, "sides exchanged"),
        ({"fy_med": WALK.fy_lat, "fy_lat": WALK.fy_med, "cop_ml_mm": -WALK.cop_ml_mm}, ""),
        ({"rz": -WALK.rz}, "flexion is negative, is its sign reversed?"),
        ({"fy_med": 0.0 * WALK.fy_med, "fy_lat": 0.0 * WALK.fy_lat}, ""),
    ],
)
def test_a_left_knee_exchanged_sides_and_reversed_flexion_get_a_warning(changes, expected):
    """A knee whose sides and centre of pressure are both mirrored is a right knee again."""
    told = warnings(replace(WALK, **changes))
    assert len(told) == bool(expected)
    assert expected in "".join(told)


@pytest.mark.parametrize("aside_mm", [-8.0, 8.0])
@pytest.mark.parametrize(("image", "expected"), [("", ""), ("mirrored", "left knee"), ("exchanged", "exchanged")])
def test_sides_are_told_wherever_the_scene_has_its_origin(image, expected, aside_mm, monkeypatch):
    """The knee's elements and centres of pressure, seen from a frame that lies to the side."""
    scene = cc.load_scene("knee")
    elements = scene.elements((20, 15))
    moved = [replace(patch, centres_mm=patch.centres_mm + np.array([0.0, 0.0, aside_mm])) for patch in elements]
    monkeypatch.setattr(type(scene), "elements", lambda *_: moved)
    middle = {
        "": aside_mm + WALK.cop_ml_mm,
        "mirrored": -aside_mm - WALK.cop_ml_mm,
        "exchanged": aside_mm - WALK.cop_ml_mm,
    }
    told = warnings(replace(WALK, cop_ml_mm=middle[image]))
    assert len(told) == bool(expected)
    assert expected in "".join(told)
    assert "or are" not in "".join(told), "only one of the two explains it"


def test_forces_that_pull_a_hip_out_of_its_cup_get_a_warning():
    cycle = scene_cycles(cc.load_scene("hip"))[0]
    assert warnings(cycle, "hip") == []
    (told,) = warnings(replace(cycle, loads={name: -curve for name, curve in cycle.loads.items()}), "hip")
    assert "contact only pushes" in told
    aside = replace(cycle, loads={**cycle.loads, "Fz": -3.0 * np.abs(cycle.loads["Fz"])})
    assert warnings(aside, "hip") == [], "a force towards the rim still pushes"


def test_the_command_asks_before_it_solves(tmp_path, monkeypatch, capsys):
    asked = asked_before_solving(replace(WALK, rz=-WALK.rz), "bent", tmp_path, monkeypatch, capsys)
    assert asked.startswith("pose_estimation: bent: rz reaches ")
    assert asked.count("\n") == 1
