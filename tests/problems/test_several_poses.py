"""Pose estimation where contact carries the measured loads in several places, each frame beginning in another one."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.scenes.joint_cycle import JointCycle
from casadi_contact.scenes.walking import reference_cycle
from problems import pose_estimation
from problems.pose_estimation.estimate import estimated
from problems.pose_estimation.several_poses import elsewhere_mm, several_poses_in_words, unstable_frames
from problems.pose_estimation.solve import without_leaps
from tests.support.two_dips import DIP_MM, contact_model, height

FRAMES = 21
PLACES = np.where(np.isin(np.arange(FRAMES), [4, 5, 13]), -DIP_MM, DIP_MM)


@pytest.fixture(scope="module")
def problem():
    still = dict.fromkeys(("tz", "rx", "ry", "rz"), np.zeros(FRAMES))
    shear = 4.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, FRAMES))
    loads = {"Fx": shear, "Fy": np.full(FRAMES, -200.0)}
    return pose_estimation.build(symbolic(contact_model()), JointCycle("dips", np.arange(float(FRAMES)), still, loads))


def start_at(places):
    poses = np.zeros((FRAMES, 6))
    poses[:, 0], poses[:, 1] = places, height(places) - 0.3
    return poses


def words(problem, found):
    away = elsewhere_mm(problem, found.result)
    return list(several_poses_in_words(problem, found.result, found.verdict.leaps, away))


def test_frames_that_begin_elsewhere_are_solved_beside_their_neighbours(problem):
    alone = pose_estimation.solve(problem, start_at(PLACES))
    np.testing.assert_allclose(alone.poses[:, 0], PLACES, atol=1.0)
    found = estimated(problem, start_at(PLACES), contact_model())
    np.testing.assert_allclose(found.result.poses[:, 0], DIP_MM, atol=1.0)
    assert found.verdict.verified.all()
    assert found.verdict.exit_code == 0
    elsewhere = elsewhere_mm(problem, found.result).max()
    assert elsewhere == pytest.approx(DIP_MM, abs=1.0), "the ridge between the dips"
    (said,) = words(problem, found)
    assert f"of {FRAMES} of {FRAMES} frames in another pose as well, up to {elsewhere:.3g} mm away" in said


def test_a_leap_that_stays_is_told_and_its_frames_are_not_verified(problem, monkeypatch):
    monkeypatch.setattr("problems.pose_estimation.completion.without_leaps", lambda problem, result: result)
    found = estimated(problem, start_at(PLACES), contact_model())
    beside = np.isin(np.arange(FRAMES), [3, 4, 5, 6, 12, 13, 14])
    np.testing.assert_array_equal(found.verdict.verified, ~beside)
    assert found.verdict.exit_code == 3
    assert found.verdict.doubt == "their pose leaps"
    assert found.verdict.words[4] == "solved, its pose leaps"
    assert str(found.verdict).endswith("; 7 solved, but their pose leaps from one to the next")
    said, elsewhere = words(problem, found)
    assert "in another pose as well" in elsewhere
    assert "tx by 10 mm from frame 3 to 4" in said


def test_a_body_that_would_slide_off_a_ridge_is_told(problem):
    found = estimated(problem, start_at(np.zeros(FRAMES)), contact_model())
    np.testing.assert_allclose(found.result.poses[:, 0], 0.0, atol=1.0)
    assert unstable_frames(problem, found.result).all()
    elsewhere, said = words(problem, found)
    assert "in another pose as well" in elsewhere
    assert f"in {FRAMES} of {FRAMES} frames contact alone holds the body in an unstable equilibrium" in said


def test_walking_on_the_knee_is_carried_in_no_other_pose():
    walking = pose_estimation.build(cc.load_surrogate("knee"), reference_cycle(frames=21))
    result = pose_estimation.solve(walking)
    assert result.converged.all()
    assert elsewhere_mm(walking, result).tolist() == [0.0] * 21


def test_no_other_pose_is_looked_for_beside_held_translations_and_where_a_model_refuses_to_go(problem):
    model, frames = cc.foundation("sphere_in_dish"), 3
    still = {name: np.full(frames, value) for name, value in zip(POSE_NAMES, model.scene.start_pose, strict=True)}
    still["ty"] -= 0.1
    measured = {name: still[name] for name in ("tx", "ty", "tz", "ry")}
    torques = {name: np.zeros(frames) for name in ("Tx", "Tz")}
    turned = pose_estimation.build(model, JointCycle("turned", np.arange(float(frames)), measured, torques))
    assert elsewhere_mm(turned, pose_estimation.solve(turned)).tolist() == [0.0] * frames

    def shy(poses):
        if np.abs(poses[:, 0]).max() > DIP_MM + 1.0:
            raise ValueError("off the mesh")
        return dips.wrenches(poses)

    dips = contact_model()
    own = replace(problem, model=symbolic(CallableModel(dips.scene, shy)))
    result = pose_estimation.solve(problem, start_at(np.full(FRAMES, DIP_MM)))
    assert elsewhere_mm(problem, result).max() > 0.0
    assert elsewhere_mm(own, result).max() == 0.0


def test_smoothness_couples_frames_so_that_none_is_moved(problem):
    smooth = replace(problem, smoothness=1.0)
    result = pose_estimation.solve(problem, start_at(PLACES))
    assert without_leaps(smooth, result) is result
