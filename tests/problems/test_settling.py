"""Random starts about a cycle's poses settle on a foundation, each at the pose that it was moved from."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.walking import reference_cycle
from problems.studies.settling import main, settled_starts
from tests.support.command import ended


@pytest.fixture(scope="module")
def knee():
    return cc.PolarFoundation(cc.load_scene("knee"))


def test_two_mm_and_five_degrees_off_every_start_settles_at_the_pose_of_the_cycle(knee):
    found = settled_starts(knee, reference_cycle(frames=11), 40, aside_mm=2.0, turned_rad=np.radians(5.0))
    assert found.converged.all(), found.reason
    assert found.same.all()
    assert str(found).startswith("40 of 40 random starts settle, 40 of them at the pose of the cycle")


@pytest.mark.parametrize(
    ("aside", "turned", "said"),
    [
        ("inf", "5", "aside is inf mm, expected 0 to 1000"),
        ("1e308", "5", "aside is 1e+308 mm, expected 0 to 1000"),
        ("nan", "5", "aside is nan mm, expected 0 to 1000"),
        ("2", "inf", "turned is inf degrees, expected 0 to 180"),
    ],
)
def test_starts_that_are_nowhere_are_a_mistake(aside, turned, said, tmp_path, monkeypatch):
    write_cycle(reference_cycle(frames=3), tmp_path / "walk.csv")
    code = ended(monkeypatch, main, "knee", tmp_path / "walk.csv", "--aside", aside, "--turned", turned)
    assert code == f"settling: {said}"


def test_a_start_beyond_the_insert_does_not_settle_and_says_so(knee):
    found = settled_starts(knee, reference_cycle(frames=3), 10, aside_mm=60.0, turned_rad=0.0)
    assert not found.converged.all()
    assert all(reason for reason in found.reason[~found.converged])
