"""A time-delay network learns cycles in order; a single pose without its past misleads it."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.benchmark.peers import peer_candidates
from casadi_contact.benchmark.peers.history import history, with_history
from casadi_contact.benchmark.peers.training_set import TrainingSet
from casadi_contact.sampling import ReferenceMotion, SamplePoint
from tests.support.smooth_samples import SPHERE, smooth_samples


def test_inputs_are_the_frame_and_its_past():
    cycle = np.arange(24.0).reshape(1, 4, 6)
    inputs = with_history(cycle, 3)
    assert inputs.shape == (1, 4, 18)
    np.testing.assert_array_equal(inputs[0, 3], np.concatenate([cycle[0, 3], cycle[0, 2], cycle[0, 1]]))
    np.testing.assert_array_equal(inputs[0, 0], np.tile(cycle[0, 0], 3))


def rolling_motion(cycles, frames=41):
    """A sphere that rolls and presses, a little differently in each cycle."""
    share = np.linspace(0.0, 1.0, frames)
    poses = np.zeros((cycles, frames, 6))
    for k in range(cycles):
        wave = 2.0 * np.pi * share + 0.05 * k
        poses[k, :, 0] = 6.0 * np.sin(wave)
        poses[k, :, 1] = 29.85 + 0.08 * np.cos(wave) * (1.0 + 0.02 * k)
        poses[k, :, 5] = -0.2 * np.sin(wave)
    point = SamplePoint(("tx", "Fy", "tz", "rx", "ry", "rz"), ("ty",))
    return ReferenceMotion(point, np.zeros((cycles, frames, 6)), poses)


@pytest.fixture(scope="module")
def trained():
    data = TrainingSet.of(smooth_samples(100), ("Fy",))
    return {c.name: c for c in history(data, gflop=1.0, motion=rolling_motion(7))}


def test_in_sequence_it_follows_and_alone_it_fails(trained):
    unseen = rolling_motion(7).poses[3:4] * 0.5 + rolling_motion(7).poses[4:5] * 0.5
    unseen = unseen.reshape(-1, 6)
    want = cc.ElasticFoundation(SPHERE, SPHERE.grids["teacher"])(unseen)[:, [SPHERE.load_names.index("Fy")]]
    rms = {
        what: np.sqrt(np.mean((trained[f"time-delay network, {what}"].model(unseen) - want) ** 2))
        for what in ("in sequence", "single poses")
    }
    assert rms["in sequence"] < 0.02 * want.std()
    assert rms["single poses"] > 3.0 * rms["in sequence"]


def test_calls_one_after_the_other_are_the_sequence(trained):
    model = trained["time-delay network, in sequence"].model
    cycle = rolling_motion(7).poses[5]
    for pose in np.concatenate([cycle[:1], cycle[:1]]):  # the first frame stands in for its past
        model.one(pose)
    np.testing.assert_allclose([model.one(pose)[0] for pose in cycle], model(cycle)[:, 0], rtol=1e-9)


def test_without_cycles_it_stays_with_its_reason():
    (only,) = peer_candidates(smooth_samples(100), gflop=1.0, families=["time-delay network"])
    assert only.model is None
    assert "give the reference motion, of at least 2 cycles" in only.failure
