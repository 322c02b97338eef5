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
from casadi_contact.workflow.benchmark import candidates as timing_module
from casadi_contact.workflow.benchmark.candidates import compare, time_batch, time_single_calls
from casadi_contact.workflow.benchmark.front_file import Timing
from casadi_contact.workflow.benchmark.measure import unseen_walking


@pytest.mark.parametrize("cycles", [3, 1])
def test_unseen_walking_is_new_and_lies_inside_the_envelopes_or_d1_of_a_single_cycle(cycles):
    model = cc.ElasticFoundation(cc.load_scene("knee"), (40, 20))
    settings = SamplingSettings.from_scene(model.scene, frames=11)
    motion, _ = reference_motion(model, reference_cycles(count=cycles, frames=11), settings)
    poses = unseen_walking(model, motion, count=2)
    assert len(poses) >= 21
    tx = poses[:11, 0]
    assert not any(np.allclose(tx, cycle[:, 0]) for cycle in motion.poses)
    assert not np.allclose(poses[:11], poses[-11:])
    if cycles > 1:
        column = motion.envelopes.names.index("tx")
        assert (tx >= motion.envelopes.lower[:, column] - 1e-9).all()
        assert (tx <= motion.envelopes.upper[:, column] + 1e-9).all()
        return
    for name, most in {"tx": 0.5, "ry": 0.02}.items():  # half of the least assumed width; the setting's own
        shift = (poses[:11] - motion.poses[0])[:, pose_index(name)]
        assert 0.0 < np.abs(shift).max() <= 0.5 * most * (1.0 + 1e-9)


def test_times_are_seconds_per_pose_of_single_calls_and_of_batches(monkeypatch):
    clock = SimpleNamespace(now=100.0, process_time=lambda: clock.now)  # stands still unless somebody moves it on
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
    seconds = iter([9.0, 3e-6, 1e-6, 5e-6])  # of which the first warms up
    assert compare({"x": lambda: next(seconds)}, repeats=3)["x"] == Timing(*map(pytest.approx, (3.0, 1.0, 5.0)))
