"""A cycle in kN, body weights or metres gets a warning, one in N and mm gets none, nor does one without load."""

from dataclasses import replace

import pytest

import casadi_contact as cc
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.scenes.walking import reference_cycle
from problems.pose_estimation.centre_units import centre_warnings
from problems.pose_estimation.wanted import WantedLoads
from tests.support.asked import asked_before_solving


@pytest.mark.parametrize(("scale", "expected"), [(1.0, []), (1e-3, ["are they in mm, or in m?"]), (0.0, [])])
def test_centres_of_pressure_of_walking_in_metres_get_a_warning(scale, expected):
    scene, walking = cc.load_scene("knee"), reference_cycle(frames=11).wanted()
    values = {name: scale * curve if name[0] == "c" else curve for name, curve in walking.items()}
    wanted = WantedLoads.of(scene, values)
    assert [line.partition(": ")[2] for line in centre_warnings(wanted, own_model(scene))] == expected
    assert centre_warnings(wanted, "none at hand") == []


def test_the_command_asks_before_it_solves(tmp_path, monkeypatch, capsys):
    walking = reference_cycle(frames=3)
    light = replace(walking, fy_med=1e-3 * walking.fy_med, fy_lat=1e-3 * walking.fy_lat)
    asked = asked_before_solving(light, "light", tmp_path, monkeypatch, capsys)
    assert asked.startswith("pose_estimation: light: the largest force is ")
    assert asked.count("\n") == 1
