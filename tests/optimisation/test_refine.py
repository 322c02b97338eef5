"""Refinement at small scale: a sphere pressed on a plane further out than its surrogate ever saw."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples, samples_record
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate

SCENE = cc.load_scene("sphere_on_plane")
MODEL = cc.ElasticFoundation(SCENE, (60, 60))
FAR_MM = 6.0


def sampled(half_width_mm: float, count: int = 1500) -> Samples:
    """Sphere settled under loads up to 1 kN within so many mm of the middle, some lifted off."""
    rng = np.random.default_rng(4)
    poses = np.zeros((count, 6))
    poses[:, [0, 2]] = half_width_mm * rng.uniform(-1.0, 1.0, (count, 2))
    poses[:, 3:] = rng.uniform(-0.05, 0.05, (count, 3))
    poses[:, 1] = SCENE.geometry["radius"] - 0.05
    poses, report = cc.settle(MODEL, poses, ("ty",), {"Fy": -rng.uniform(5.0, 1000.0, count)})
    assert report.converged.all()
    poses[::5, 1] += rng.uniform(0.0, 1.0, len(poses[::5]))
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.8, 0.1, 0.1]).astype(np.uint8)
    return Samples(SCENE, poses, MODEL.wrenches(poses), MODEL.gaps(poses), np.ones(count, dtype=np.uint8), role)


@pytest.fixture(scope="module")
def start():
    """A small surrogate of the middle of the plane, and its samples."""
    samples = sampled(2.0)
    settings = TrainingSettings(sizes=((6, 6),), max_iterations=150)
    networks = {r.name: fit(r, settings).network for r in PatchSurrogate.regressions(samples)}
    return calibrate(PatchSurrogate(SCENE, networks, samples_record(samples)), samples), samples


def solve(surrogate):
    """Poses from the middle to FAR_MM beside it, under 200 to 800 N, unsettled ones as they are, the last in range."""
    high = surrogate.record["pose_range"]["tx"][1]
    poses = np.zeros((15, 6))
    poses[:, 0] = np.linspace(0.0, FAR_MM, 15)
    poses[-1, 0] = min(FAR_MM, high)
    poses[:, 1] = SCENE.geometry["radius"] - 0.05
    poses, report = cc.settle(surrogate, poses, ("ty",), {"Fy": -np.linspace(200.0, 800.0, 15)})
    return poses, report.converged & (poses[:, 0] == np.linspace(0.0, FAR_MM, 15))


def test_a_case_outside_the_learned_region_is_brought_to_tolerance(start):
    surrogate, samples = start
    of_another = {"model_errors": {"Fy": 0.1}, "model_errors_against": "rays", "gflop": {"root_contact": 7.0}}
    record = {**surrogate.record, **of_another, "command": "casadi-contact build sphere_on_plane"}
    surrogate = type(surrogate)(SCENE, surrogate.networks, record, surrogate.confidence)
    before = {name: network.weights[0].copy() for name, network in surrogate.networks.items()}
    told = []
    result = cc.refine(surrogate, samples, solve, MODEL, rounds=5, gflop=5.0, progress=told.append)
    first = result.verifications[0]
    assert not first.passed
    assert not first.solved[-1]
    assert first.outside.any()
    assert result.passed
    assert len(result.verifications) == len(result.added) + 1
    assert len(result.samples) == len(samples) + sum(result.added)
    assert result.surrogate.record["pose_range"]["tx"][1] >= FAR_MM
    assert result.surrogate.record["refined"] == len(result.added)
    assert solve(result.surrogate)[1].all()
    assert told
    record = result.surrogate.record
    assert record["command"] == "cc.refine in Python, of what this makes: casadi-contact build sphere_on_plane"
    assert set(record["stop_reasons"]) == set(record["gflop"]) == set(record["seconds"]) == set(surrogate.networks)
    rounds = len(result.added)
    assert 7.0 < record["gflop"]["root_contact"] < 7.0 + 6.0 * rounds, "of what was before as well"
    assert not {"model_errors", "model_errors_against"} & set(record), "they were another model's"
    for name, weights in before.items():
        np.testing.assert_array_equal(surrogate.networks[name].weights[0], weights, "the given one is unchanged")


def test_what_passes_is_returned_as_it_is_and_rounds_may_be_used_up(start):
    surrogate, samples = start
    given_up = cc.refine(surrogate, samples, solve, MODEL, rounds=0)
    assert not given_up.passed
    assert given_up.surrogate is surrogate
    at_home = cc.refine(surrogate, samples, lambda _: (samples.poses[:1], np.array([True])), surrogate)
    assert at_home.passed
    assert at_home.added == []
    assert at_home.surrogate is surrogate


def test_new_samples_lie_evenly_around_the_failing_frames(start):
    """Pose inputs up to 0.3 scales to either side, loads 0.2 to 1.3 times the surrogate's, a tenth lifted off."""
    surrogate, samples = start
    frames, _ = cc.settle(MODEL, [[FAR_MM, 29.95, 0.0, 0.0, 0.0, 0.0]], ("ty",), {"Fy": -500.0})
    result = cc.refine(
        surrogate, samples, lambda _: (frames, np.array([True])), MODEL, rounds=1, gflop=1e-6, per_frame=300
    )
    new = result.samples.rows(np.arange(len(samples), len(result.samples)))
    assert len(new) > 250
    for column in (0, 2, 3, 4, 5):
        off = (new.poses[:, column] - frames[0, column]) / (0.3 * surrogate.confidence.scales[column])
        assert 0.95 < off.max() <= 1.0 + 1e-9
        assert -1.0 - 1e-9 <= off.min() < -0.95
        assert abs(off.mean()) < 0.15
    shares = (new.loads(["Fy"]) / surrogate(frames, ["Fy"]))[new.domain == 1, 0]
    assert 0.19 < shares.min() < 0.25
    assert 1.25 < shares.max() < 1.31
    assert 0.05 < (new.wrenches == 0.0).all(axis=(1, 2)).mean() < 0.4


def test_mistakes_are_named(start):
    surrogate, samples = start
    with pytest.raises(ValueError, match="rounds is -1"):
        cc.refine(surrogate, samples, solve, MODEL, rounds=-1)
    sunk = np.array([[1e4, 500.0, 0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="no sample could be drawn"):
        cc.refine(surrogate, samples, lambda _: (sunk, np.array([True])), MODEL)
    for answer in (sunk, [sunk, np.array([True])], (sunk,)):
        with pytest.raises(ValueError, match="solve returned a"):
            cc.refine(surrogate, samples, lambda _, answer=answer: answer, MODEL)
