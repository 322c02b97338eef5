"""Lazy learning answers from its store where that is good enough, and asks and remembers where it is not."""

import numpy as np
import pytest

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.workflow.benchmark.peers.lazy_learning import LazyLearner, lazy_learning
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from tests.support.smooth_samples import NAMES, SPHERE, SPREAD, scaled, smooth_poses, smooth_samples


def plane_wrenches(poses):
    values = np.zeros((len(poses), 1, 6))
    values[:, 0, 1] = -1000.0 + scaled(poses) @ [10.0, 200.0, 30.0, 5.0, 40.0, 20.0]
    values[:, 0, 0] = scaled(poses) @ [3.0, 1.0, 5.0, 0.0, 1.0, 2.0]
    return values


@pytest.fixture
def learner():
    data = TrainingSet.of(smooth_samples(600, plane_wrenches), NAMES)
    return LazyLearner(data, CallableModel(SPHERE, plane_wrenches), 1.0)


def test_a_plane_is_reproduced_without_asking(learner):
    poses = learner_poses = smooth_poses(40, seed=8) * 0.3 + 0.7 * smooth_poses(1, seed=8)[0]
    np.testing.assert_allclose(learner(poses), plane_wrenches(learner_poses)[:, 0, [1, 0, 3]], rtol=1e-6, atol=1e-4)
    assert learner.asked == 0


def test_far_from_every_sample_it_asks(learner):
    far = smooth_poses(1)[0] - 20.0 * SPREAD
    np.testing.assert_allclose(learner.one(far), plane_wrenches(far[None])[0, 0, [1, 0, 3]])
    assert learner.asked == 1


def test_inconsistent_neighbours_make_it_ask():
    def rough(poses):
        values = plane_wrenches(poses)
        values[:, 0, 0] += 500.0 * np.sin(40.0 * scaled(poses)[:, 0])
        return values

    data = TrainingSet.of(smooth_samples(600, rough), NAMES)
    poses = smooth_poses(20, seed=3)
    strict = LazyLearner(data, CallableModel(SPHERE, rough), 1.0)
    np.testing.assert_allclose(strict(poses), rough(poses)[:, 0, [1, 0, 3]])
    assert strict.asked == 20
    lenient = LazyLearner(data, CallableModel(SPHERE, rough), 1e4)
    lenient(poses)
    assert lenient.asked < 20


@pytest.mark.parametrize(("limit_in_deviations", "asks"), [(0.5, 1.0), (1.3, 0.0)])
def test_it_asks_where_the_neighbours_miss_their_plane_by_more_than_the_limit(limit_in_deviations, asks):
    """Noise of a known deviation on a plane is what neighbours miss it by, about: a limit of half of it asks nearly
    always, one above it hardly ever."""
    deviation, tolerance = 50.0, SPHERE.tolerances["Fx"]

    def noisy(poses):
        values = plane_wrenches(poses)
        values[:, 0, 0] += deviation * np.random.default_rng(len(poses)).standard_normal(len(poses))
        return values

    data = TrainingSet.of(smooth_samples(2000, noisy), ("Fx",))
    learner = LazyLearner(data, CallableModel(SPHERE, noisy), limit_in_deviations * deviation / tolerance)
    poses = smooth_poses(1, seed=8)[0] * 0.7 + smooth_poses(60, seed=8) * 0.3
    asked = 0
    for pose in poses:
        learner.reset()
        learner.one(pose)
        asked += learner.asked
    assert abs(asked / len(poses) - asks) < 0.35


def test_answers_are_remembered_within_a_sequence_and_forgotten_between_sequences(learner):
    rng = np.random.default_rng(1)
    cloud = smooth_poses(1)[0] - 20.0 * SPREAD + 0.1 * SPREAD * rng.uniform(-1.0, 1.0, (80, 6))
    loads = learner(cloud)
    first = learner.asked
    assert 28 <= first < 60, "once enough neighbours are known nearby, they answer"
    np.testing.assert_allclose(loads, plane_wrenches(cloud)[:, 0, [1, 0, 3]], rtol=1e-6, atol=1e-3)
    learner(cloud)
    assert learner.asked == first


def test_candidates_count_how_often_they_asked():
    made = list(lazy_learning(TrainingSet.of(smooth_samples(600))))
    assert [c.family for c in made] == ["lazy learning"] * 3
    assert all("of 60 validation poses" in c.remark for c in made)
    assert made[0].time_value(smooth_poses(5)) > 0.0
