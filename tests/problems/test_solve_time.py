"""Whole solve time against error: every contact model of a scene solves the same cycle."""

from importlib import import_module

import pytest

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.scenes.walking import reference_cycle
from problems.studies import solve_time
from tests.support.compiler import needs_compiler


@needs_compiler
def test_finer_models_carry_the_loads_of_a_converged_foundation_at_the_poses_that_they_find(monkeypatch, tmp_path):
    monkeypatch.setattr(import_module("casadi_contact.contact.choice"), "POLAR_LADDER", (Rays(8, 2),))
    monkeypatch.setattr(solve_time, "shipped_surrogates", lambda scene: {"knee": cc.load_surrogate("knee")})
    front = solve_time.measured_front(cc.load_scene("knee"), reference_cycle(frames=5), repeats=1)
    points = {point.name: point for point in front.points}
    assert len(points) == 5
    for point in points.values():
        assert not point.failure
        assert point.value.median_us > 0.0
    coarse, fine = points["EF 40×30"], points["EF 80×40"]
    coarser, chosen = points["foundation 8 rays × 2 points"], points["foundation 8 rays × 3 points"]
    assert chosen.force_rms_n < coarser.force_rms_n < fine.force_rms_n < coarse.force_rms_n
    assert points["knee"].force_rms_n == pytest.approx(0.17, rel=1.0)
    assert solve_time.draw(front).axes
