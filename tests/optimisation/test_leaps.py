"""A pose leaps where it steps far beyond what it does beside: not where few frames make every step long."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.continuity import leaps
from casadi_contact.optimisation import knee as knee_module
from casadi_contact.optimisation import starts


def walking(frames):
    """A smooth motion (frames, 6): 20 mm to and fro along x, 60 degrees about z."""
    phase = np.linspace(0.0, 2.0 * np.pi, frames)
    poses = np.zeros((frames, 6))
    poses[:, 0], poses[:, 5] = 10.0 * np.cos(phase), -0.5 * (1.0 - np.cos(phase))
    return poses


@pytest.mark.parametrize("frames", [2, 3, 7, 15, 21, 101, 1001])
def test_a_smooth_motion_does_not_leap_however_few_frames_it_has(frames):
    assert not leaps(walking(frames)).any()


def test_a_change_of_branch_and_a_frame_on_another_one_are_found():
    poses = walking(101)
    poses[40:, 2] += 3.4
    poses[70, 3] += np.radians(5.0)
    assert np.argwhere(leaps(poses)).tolist() == [[39, 2], [69, 3], [70, 3]]


def test_frames_that_settle_on_another_branch_follow_their_neighbours(monkeypatch):
    """A shear that vanishes at two places, and frames of which the middle leads to one or to the other."""

    def two_places(model, poses):
        """Newton's method on Fx ~ (tx - 1)(tx - 5) ends at the nearer zero, but for frames that begin in the middle."""
        found = poses.copy()
        begun = np.where(poses[:, 0] == middle, np.where(poses[:, 5] < -0.3, 5.0, 1.0), poses[:, 0])
        found[:, 0] = np.where(begun < 3.0, 1.0, 5.0)
        return found, np.zeros(len(poses))

    knee = cc.load_surrogate("knee")
    middle = starts.middle_pose(knee)[0]
    monkeypatch.setattr(knee_module, "_without_shear", two_places)
    rz = -0.6 * np.sin(np.linspace(0.0, np.pi, 41))
    poses = knee_module.shear_free_poses(knee, np.zeros(41), rz)
    np.testing.assert_array_equal(poses[:, 0], poses[0, 0])
