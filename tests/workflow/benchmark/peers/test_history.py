"""History models learn cycles in order; a single pose without its past misleads them."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.settings import SamplePoint
from casadi_contact.workflow.benchmark.peers.candidates import peer_candidates
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.history.hammerstein_wiener import hammerstein_wiener
from casadi_contact.workflow.benchmark.peers.history.in_time import follow
from casadi_contact.workflow.benchmark.peers.history.models import HISTORY_MODELS, history
from casadi_contact.workflow.benchmark.peers.history.time_delay import with_history
from casadi_contact.workflow.benchmark.peers.training_set import Limits, TrainingSet
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
    candidates = (c for family in HISTORY_MODELS for c in history(family, data, 1.0, rolling_motion(7)))
    return {c.name: c for c in candidates}


@pytest.mark.parametrize(
    ("family", "share"), [("time-delay network", 0.02), ("NARX network", 0.05), ("Hammerstein-Wiener", 0.1)]
)
def test_in_sequence_they_follow(trained, family, share):
    unseen = rolling_motion(7).poses[3:4] * 0.5 + rolling_motion(7).poses[4:5] * 0.5
    unseen = unseen.reshape(-1, 6)
    want = cc.ElasticFoundation(SPHERE, SPHERE.grids["teacher"])(unseen)[:, [SPHERE.load_names.index("Fy")]]
    rms = {
        what: np.sqrt(np.mean((trained[f"{family}, {what}"].model(unseen) - want) ** 2))
        for what in ("in sequence", "single poses")
    }
    assert rms["in sequence"] < share * want.std()


@pytest.mark.parametrize("family", HISTORY_MODELS)
def test_calls_one_after_the_other_are_the_sequence(trained, family):
    model = trained[f"{family}, in sequence"].model
    cycle = rolling_motion(7).poses[5]
    np.testing.assert_allclose([model.one(pose)[0] for pose in cycle], model(cycle)[:, 0], rtol=1e-9)


@pytest.mark.parametrize("family", HISTORY_MODELS)
def test_a_motion_that_rests_stays_at_its_loads(trained, family):
    cycle = rolling_motion(7).poses[5]
    still = np.repeat(cycle[7:8], 41, axis=0)
    loads = trained[f"{family}, in sequence"].model(still)
    single = trained[f"{family}, single poses"].model(cycle[7:8])
    np.testing.assert_allclose(loads, np.repeat(single, 41, axis=0), rtol=1e-3)


def test_a_hammerstein_wiener_system_is_found_again():
    """Its own kind of system, curves, filter and output, from data that it has not seen."""
    rng = np.random.default_rng(3)
    poses = np.cumsum(rng.normal(size=(8, 120, 6)), axis=1) * 0.1
    u = np.sin(poses[..., 0]) + poses[..., 1] ** 2
    w = np.zeros_like(u)
    w[:, 0] = u[:, 0]
    for t in range(1, u.shape[1]):
        w[:, t] = 0.6 * w[:, t - 1] + 0.4 * u[:, t]
    loads = np.tanh(0.5 * w)[..., None] * 100.0
    limits = Limits(np.array([-np.inf]), np.array([np.inf]))
    cycles = Cycles(("Fy",), poses, loads, 2, loads.mean((0, 1)), loads.std((0, 1)), limits)
    model = hammerstein_wiener(cycles, 3.0)
    unseen, want = cycles.judged
    assert np.sqrt(np.mean((follow(model, unseen) - want) ** 2)) < 0.1 * want.std()


@pytest.mark.parametrize("family", HISTORY_MODELS)
def test_without_cycles_it_stays_with_its_reason(family):
    (only,) = peer_candidates(smooth_samples(100), gflop=1.0, families=[family])
    assert only.model is None
    assert "give the reference motion, of at least 2 cycles" in only.failure
