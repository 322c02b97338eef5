"""Poses over the whole sampled range that are asked of a contact model."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.samples.perturbed import uniform_samples
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene

SCENE = load_scene("sphere_on_plane")
LOW, HIGH = np.array([-3.0, 29.0, -2.0, -0.1, -0.2, -0.3]), np.array([3.0, 30.5, 1.0, 0.1, 0.1, 0.2])


def drawn(validity=lambda poses: np.ones(len(poses)), count=400):
    """With the two corners as samples, and a test row far beyond them."""
    poses = np.array([LOW, HIGH, HIGH + 5.0])
    role = np.array([TRAIN, VALIDATION, TEST], dtype=np.uint8)
    samples = Samples(SCENE, poses, np.zeros((3, 1, 6)), np.ones((3, 1)), np.ones(3, dtype=np.uint8), role)
    model = ElasticFoundation(SCENE, (20, 20))
    return uniform_samples(samples, model, validity, lambda poses: 30.0 - poses[:, 1:2], count=count), model


def test_poses_lie_all_over_the_range_with_the_models_loads_and_half_of_them_press():
    """The sphere's radius is 30 mm: it presses where its centre is lower."""
    found, model = drawn()
    poses = np.concatenate([found.poses, found.dropped.poses])
    assert len(poses) == 400
    assert (poses >= LOW).all()
    assert (poses <= HIGH).all()
    for column in (0, 2, 3, 4, 5):
        counts, _ = np.histogram(poses[:, column], 4, (LOW[column], HIGH[column]))
        assert counts.min() > 50
    assert np.mean(poses[:, 1] < 30.0) == 0.5
    np.testing.assert_array_equal(found.wrenches, model.wrenches(found.poses))
    assert abs(np.mean(found.role == TEST) - 0.5) < 0.05
    assert not (found.role == TRAIN).any()


def test_the_librarys_own_model_is_asked_more_often_than_one_that_may_be_slow():
    """A third as many as the samples: 1,500 that were held back tell a share of 95 % to one hundredth, 300 to three."""
    poses = np.tile([LOW, HIGH], (9000, 1))
    rows, role = len(poses), np.full(len(poses), TRAIN, dtype=np.uint8)
    own = Samples(SCENE, poses, np.zeros((rows, 1, 6)), np.ones((rows, 1)), np.ones(rows, dtype=np.uint8), role)
    librarys = replace(own, provenance={"models": "elements"})
    found = [
        uniform_samples(
            samples,
            ElasticFoundation(SCENE, (8, 8)),
            lambda poses: np.ones(len(poses)),
            lambda poses: 30.0 - poses[:, 1:2],
        )
        for samples in (own, librarys)
    ]
    assert [len(one) + len(one.dropped.poses) for one in found] == [2000, 6000]


def test_poses_that_are_not_valid_are_not_asked_and_fewer_are_found_where_few_are():
    found, _ = drawn(lambda poses: np.where(poses[:, 0] > 0.0, 1.0, 0.05))
    assert (found.poses[:, 0] > 0.0).all()
    none, _ = drawn(lambda poses: np.zeros(len(poses)), count=10)
    assert len(none) == 0


def test_samples_of_which_none_was_learned_have_no_range():
    poses = np.array([LOW, HIGH])
    role = np.full(2, TEST, dtype=np.uint8)
    samples = Samples(SCENE, poses, np.zeros((2, 1, 6)), np.ones((2, 1)), np.ones(2, dtype=np.uint8), role)
    with pytest.raises(ValueError, match="all of them test rows"):
        uniform_samples(samples, ElasticFoundation(SCENE, (20, 20)), lambda poses: poses[:, 0], lambda poses: poses)
