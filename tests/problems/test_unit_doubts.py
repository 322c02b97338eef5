"""A cycle in body weights or metres is doubted, one in N and mm is not, nor one without load."""

import pytest

import casadi_contact as cc
from casadi_contact.motion.walking import reference_cycle
from problems.pose_estimation.unit_doubts import unit_doubts
from problems.pose_estimation.wanted import WantedLoads


@pytest.mark.parametrize(
    ("force", "centre", "doubted"),
    [
        (1.0, 1.0, []),
        (1.0 / 750.0, 1.0, ["are forces in N, or in body weights?"]),
        (1.0, 1e-3, ["are they in mm, or in m?"]),
        (1.0 / 750.0, 1e-3, ["are forces in N, or in body weights?", "are they in mm, or in m?"]),
        (0.0, 0.0, []),
    ],
)
def test_walking_in_other_units_is_doubted(force, centre, doubted):
    scale = {"F": force, "c": centre}
    walking = reference_cycle(frames=11).wanted()
    wanted = WantedLoads.of(cc.load_scene("knee"), {name: scale[name[0]] * curve for name, curve in walking.items()})
    assert [line.partition(": ")[2] for line in unit_doubts(wanted)] == doubted
