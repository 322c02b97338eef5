"""Timings and the unseen walking that errors are stated on are what their names say."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import pose_index
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.walking import reference_cycles
from casadi_contact.workflow.benchmark import timing as timing_module
from casadi_contact.workflow.benchmark.evaluate import unseen_walking
from casadi_contact.workflow.benchmark.timing import compare, time_batch, time_single_calls


def unseen(cycles):
    """A reference motion of so many cycles of 11 frames, and two unseen cycles beside it."""
    model = cc.ElasticFoundation(cc.load_scene("knee"), (40, 20))
    settings = SamplingSettings.from_scene(model.scene, frames=11)
    motion, _ = reference_motion(model, reference_cycles(count=cycles, frames=11), settings)
    return motion, unseen_walking(model, motion, count=2)


def test_unseen_walking_lies_inside_the_envelopes_and_is_new():
    motion, poses = unseen(3)
    assert len(poses) >= 21
    envelopes = motion.envelopes
    tx = poses[:11, 0]
    column = envelopes.names.index("tx")
    assert np.all(tx >= envelopes.lower[:, column] - 1e-9)
    assert np.all(tx <= envelopes.upper[:, column] + 1e-9)
    assert not any(np.allclose(tx, cycle[:, 0]) for cycle in motion.poses)


def test_unseen_cycles_of_a_single_one_lie_beside_it_inside_d1():
    motion, poses = unseen(1)
    assert len(poses) >= 21
    seen, offset = motion.poses[0], {"tx": 0.5, "ry": 0.02}  # half of the least assumed width; the setting's own
    for name, most in offset.items():
        column = pose_index(name)
        shift = poses[:11, column] - seen[:, column]
        assert 0.0 < np.abs(shift).max() <= 0.5 * most * (1.0 + 1e-9)
    assert not np.allclose(poses[:11], poses[-11:])


def test_times_are_seconds_per_pose_of_single_calls_and_of_batches(monkeypatch):
    clock = SimpleNamespace(now=100.0, perf_counter=lambda: clock.now)  # stands still unless somebody moves it on
    monkeypatch.setattr(timing_module, "time", clock)

    class Slow(ca.Callback):
        """Takes two seconds a call."""

        def __init__(self, columns):
            super().__init__()
            self.columns = columns
            self.construct("slow", {})

        def get_sparsity_in(self, i):
            return ca.Sparsity.dense(6, self.columns)

        def eval(self, arguments):
            clock.now += 2.0
            return [0.0]

    def batch(poses):
        clock.now += 2.0

    poses = np.ones((10, 6))
    assert time_batch(batch, poses) == pytest.approx(0.2)
    assert timing_module.time_mapped(Slow(10), poses) == pytest.approx(0.2)
    assert time_single_calls(Slow(1), poses) == pytest.approx(2.0)


def test_timings_call_what_they_time():
    x = ca.MX.sym("x", 6)
    function = ca.Function("double", [x], [2 * x])
    poses = np.ones((10, 6))
    seen = []
    times = compare(
        {"batch": lambda: time_batch(seen.append, poses), "single": lambda: time_single_calls(function, poses)},
        repeats=3,
    )
    assert len(seen) == 4  # a warm-up and three repeats
    for timing in times.values():
        assert 0.0 < timing.low_us <= timing.median_us <= timing.high_us
