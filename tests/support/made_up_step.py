"""A step of a foot on the ground that the contact model made itself."""

import numpy as np

from problems.ground_contact import PARAMETERS, Step, ground_wrench


def made_up(foot, frames=9):
    """A foot that rolls over from heel to ball under some 500 N; the truth is softer than the scene."""
    share = np.linspace(0.0, 1.0, frames)
    poses = np.zeros((frames, 6))
    poses[:, 1], poses[:, 5] = 20.0, 0.06 - 0.12 * share
    poses[:, 0] = 0.5 * share
    scene = {**vars(foot.scene.material), **vars(foot.scene.friction)}
    truth = np.array([scene.get(name, 0.0) for name in PARAMETERS]) * [0.8, *[1.0] * 8]
    rates = np.gradient(poses, 0.02 * np.arange(frames), axis=0)
    wrench = np.asarray(ground_wrench(foot).map(frames)(poses.T, rates.T, truth)).T
    return Step(0.02 * np.arange(frames), poses, wrench), truth
