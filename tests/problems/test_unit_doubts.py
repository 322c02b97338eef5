"""A cycle in kN, body weights or metres is doubted, one in N and mm is not, nor one without load."""

from dataclasses import replace

import pytest

import casadi_contact as cc
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.verification import own_model
from problems.pose_estimation.unit_doubts import unit_doubts
from problems.pose_estimation.wanted import WantedLoads
from tests.support.asked import asked_before_solving


@pytest.mark.parametrize(
    ("force", "centre", "doubted"),
    [
        (1.0, 1.0, []),
        (1.0 / 750.0, 1.0, ["are forces in N, or in kN or body weights?"]),
        (1e-3, 1.0, ["are forces in N, or in kN or body weights?"]),
        (1.0, 1e-3, ["are they in mm, or in m?"]),
        (1.0 / 750.0, 1e-3, ["are forces in N, or in kN or body weights?", "are they in mm, or in m?"]),
        (0.0, 0.0, []),
    ],
)
def test_walking_in_other_units_is_doubted(force, centre, doubted):
    scale = {"F": force, "c": centre}
    walking = reference_cycle(frames=11).wanted()
    scene = cc.load_scene("knee")
    wanted = WantedLoads.of(scene, {name: scale[name[0]] * curve for name, curve in walking.items()})
    assert [line.partition(": ")[2] for line in unit_doubts(wanted, own_model(scene))] == doubted
    forces = [line for line in doubted if "forces" in line]
    assert [line.partition(": ")[2] for line in unit_doubts(wanted, "none at hand")] == forces


def test_the_command_asks_before_it_solves(tmp_path, monkeypatch, capsys):
    walking = reference_cycle(frames=3)
    light = replace(walking, fy_med=1e-3 * walking.fy_med, fy_lat=1e-3 * walking.fy_lat)
    asked = asked_before_solving(light, "light", tmp_path, monkeypatch, capsys)
    assert asked.startswith("pose_estimation: light: the largest force is ")
    assert asked.count("\n") == 1
