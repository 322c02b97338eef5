"""Verification of solved poses on a contact model."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.pose_estimation import PoseEstimation
from casadi_contact.scenes.walking import reference_cycle
from tests.support.random_surrogates import random_surrogate


@pytest.fixture(scope="module")
def poses(knee):
    return PoseEstimation.of_cycle(knee, reference_cycle(frames=21)).solve().poses


def test_a_solution_in_the_learned_region_passes(knee, poses):
    model = cc.ElasticFoundation(knee.scene, knee.scene.grids["teacher"])
    check = cc.verify(knee, poses, model)
    assert check.passed
    assert not check.outside.any()
    np.testing.assert_allclose(check.errors, knee(poses) - model(poses))
    np.testing.assert_allclose(check.rms, np.sqrt(np.mean(check.errors**2, axis=0)))
    assert (check.worst >= check.rms).all()
    text = str(check)
    assert "passed" in text
    assert "too large" not in text
    assert "0 of 21 frames outside" in text
    assert all(name in text for name in knee.load_names)


def test_wrong_loads_and_frames_outside_do_not_pass(knee, poses):
    """A grid of 20×15 elements differs by more than the tolerance; a pose pushed aside is outside and named."""
    coarse = cc.verify(knee, poses, cc.ElasticFoundation(knee.scene, (20, 15)))
    assert not coarse.passed
    assert "too large" in str(coarse)
    aside = poses.copy()
    aside[4, 2] += 4.0
    check = cc.verify(knee, aside, knee)
    assert not check.errors.any(), "a surrogate agrees with itself"
    assert check.outside.nonzero()[0].tolist() == [4]
    assert check.failing.nonzero()[0].tolist() == [4]
    assert not check.passed
    assert "1 of 21 frames (4) outside the learned region" in str(check)


def test_frames_that_the_solver_gave_up_do_not_pass(knee, poses):
    solved = np.arange(len(poses)) != 7
    check = cc.verify(knee, poses, knee, solved)
    assert not check.passed
    assert check.failing.nonzero()[0].tolist() == [7]
    assert "1 of 21 frames (7) not solved" in str(check)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_frames_at_which_the_model_gives_no_loads_do_not_pass_and_leave_the_errors_of_the_others(knee, poses, number):
    silent = [3, 11]

    class Silent:
        load_names = knee.load_names

        def __call__(self, asked):
            loads = knee(asked) + 0.25
            loads[silent] = number
            return loads

    check = cc.verify(knee, poses, Silent())
    assert check.failing.nonzero()[0].tolist() == silent
    assert not check.passed
    np.testing.assert_allclose(check.rms, 0.25)
    np.testing.assert_allclose(check.worst, 0.25)
    assert "2 of 21 frames (3, 11) at which the model gives no finite loads" in str(check)
    assert "too large" not in str(check)


def test_mistakes_are_named(knee, poses):
    with pytest.raises(ValueError, match=r"solved has shape \(3,\)"):
        cc.verify(knee, poses, knee, np.ones(3, dtype=bool))
    with pytest.raises(ValueError, match="poses"):
        cc.verify(knee, np.empty((0, 6)), knee)
    sphere = cc.ElasticFoundation(cc.load_scene("sphere_on_plane"))
    with pytest.raises(ValueError, match="Fy_med"):
        cc.verify(knee, poses, sphere)
    with pytest.raises(ValueError, match="calibrate"):
        cc.verify(random_surrogate(knee.scene, "patch"), poses, knee)


@pytest.mark.parametrize("wrong", ["False", np.nan, 2.0])
def test_what_is_no_truth_does_not_count_as_solved(knee, poses, wrong):
    with pytest.raises(ValueError, match=r"solved holds .*, expected True or False"):
        cc.verify(knee, poses[:1], knee, solved=[wrong])
