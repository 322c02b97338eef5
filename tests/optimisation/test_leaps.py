"""A pose leaps where it steps far beyond what it does beside: not where few frames make every step long."""

import numpy as np
import pytest

from casadi_contact.optimisation.verification import beside_leaps


def walking(frames):
    """A smooth motion (frames, 6): 20 mm to and fro along x, 60 degrees about z."""
    phase = np.linspace(0.0, 2.0 * np.pi, frames)
    poses = np.zeros((frames, 6))
    poses[:, 0], poses[:, 5] = 10.0 * np.cos(phase), -0.5 * (1.0 - np.cos(phase))
    return poses


@pytest.mark.parametrize("frames", [2, 3, 7, 15, 21, 101, 1001])
def test_a_smooth_motion_does_not_leap_however_few_frames_it_has(frames):
    assert not beside_leaps(walking(frames)).any()


def test_a_change_of_branch_and_a_frame_on_another_one_are_found():
    poses = walking(101)
    poses[40:, 2] += 3.4
    poses[70, 3] += np.radians(5.0)
    assert np.argwhere(beside_leaps(poses)).tolist() == [[39, 2], [40, 2], [69, 3], [70, 3], [71, 3]]
