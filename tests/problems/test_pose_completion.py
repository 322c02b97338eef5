"""Frames beyond what a surrogate has learned: on the contact model, on its rim, or without an equilibrium."""

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.settle import settle
from casadi_contact.optimisation.verification.verdict import judge
from casadi_contact.scenes.walking import reference_cycle
from problems import pose_estimation
from problems.common.contact import ContactSource
from problems.pose_estimation.completion import complete, solve_and_complete
from problems.pose_estimation.estimate import estimated
from problems.pose_estimation.reach import beyond_reach_mm
from problems.pose_estimation.report import _learnable
from problems.pose_estimation.search import search
from problems.pose_estimation.starts import solve_from_random_starts
from problems.pose_estimation.wanted import WantedLoads

FREE, LOADS = ("tx", "ty", "tz", "rx"), ("Fy_med", "Fy_lat", "Tx", "Tz")
SWING = np.arange(66, 93, 2)


@pytest.fixture(scope="module")
def foundation(knee):
    return cc.ElasticFoundation(knee.scene, knee.scene.grids["settle"])


def swing(peak_mm):
    """The swing phase of the reference cycle, in the middle of it 120 N with a centre of pressure peak_mm behind."""
    cycle = reference_cycle()
    share = np.sin(np.linspace(0.0, np.pi, len(SWING)))
    total = (cycle.fy_med + cycle.fy_lat)[SWING]
    lighter = 1.0 - share * (1.0 + 120.0 / total)
    return replace(
        cycle,
        **{key: getattr(cycle, key)[SWING] for key in ("time_s", "rz", "ry", "cop_ml_mm")},
        cop_ap_mm=(1.0 - share) * cycle.cop_ap_mm[SWING] + share * peak_mm,
        fy_med=lighter * cycle.fy_med[SWING],
        fy_lat=lighter * cycle.fy_lat[SWING],
    )


@pytest.fixture(scope="module")
def completed(knee, foundation):
    problem = pose_estimation.build(knee, swing(29.0))
    return problem, solve_and_complete(problem, None, foundation)


def test_a_swing_phase_ends_frame_by_frame_on_the_insert_on_its_rim_or_without_equilibrium(completed, foundation):
    problem, result = completed
    kinds = ("fits on the insert: outside the learned range (tx by", "carried on its rim: outside", "no equilibrium on")
    said = [sum(kind in reason for reason in result.reason) for kind in kinds]
    assert min(said) >= 1, result.reason
    assert sum(said) == (result.reason != "").sum() == (result.on_model | ~result.converged).sum()
    assert result.iterations < 150, "a march of frames that have no pose in the learned range took 647"
    edge = foundation.at_edge(result.poses).any(axis=1)
    for frame in np.flatnonzero(result.on_model):
        assert edge[frame] == ("on its rim" in result.reason[frame])
    np.testing.assert_array_equal(result.on_rim, result.on_model & edge)
    assert np.abs(problem.cycle.cop_ap_mm - 29.0)[~result.converged].max() < 4.0, "only far behind is there none"


def test_centres_of_pressure_that_no_contact_has_are_infeasible_though_a_surrogate_extrapolates_to_them(foundation):
    """40 mm behind the middle pressure on the insert of any size has none: loads there are a network's alone."""
    reach, cycle = cc.load_surrogate("knee_reach"), reference_cycle()
    frames = np.arange(30, 60, 5)
    kept = {key: getattr(cycle, key)[frames] for key in ("time_s", "rz", "ry", "fy_med", "fy_lat", "cop_ml_mm")}
    behind = np.arange(len(frames)) >= 3
    problem = pose_estimation.build(
        reach, replace(cycle, **kept, cop_ap_mm=np.where(behind, 40.0, cycle.cop_ap_mm[frames]))
    )
    assert pose_estimation.solve(problem).converged[behind].any(), "no frame is extrapolated: this test tells nothing"
    result = solve_and_complete(problem, None, foundation)
    np.testing.assert_array_equal(result.converged, ~behind)
    assert all("infeasible: " in reason for reason in result.reason[behind])


def test_frames_on_the_contact_model_carry_the_measured_loads_there(completed, foundation):
    problem, result = completed
    on = result.on_model
    wanted = np.column_stack([problem.cycle.targets()[name] for name in LOADS])[on]
    columns = [foundation.load_names.index(name) for name in LOADS]
    np.testing.assert_allclose(foundation(result.poses[on])[:, columns], wanted, rtol=0.0, atol=0.3)
    np.testing.assert_array_equal(result.loads[on], foundation(result.poses[on])[:, columns])
    np.testing.assert_array_equal(result.poses[on][:, 4:], np.column_stack([problem.cycle.ry, problem.cycle.rz])[on])


def test_the_verdict_tells_frames_on_the_contact_model_apart(completed, knee, foundation):
    _, result = completed
    verdict = judge(knee, result.poses, result.converged, foundation, LOADS, result.on_model)
    for frame, words in enumerate(verdict.words):
        expected = "solved and verified" if result.converged[frame] else "not solved"
        assert words == ("solved on the contact model" if result.on_model[frame] else expected)
    assert f"{int(result.on_model.sum())} of them on it alone" in str(verdict)
    assert verdict.exit_code == 2


def test_only_a_surrogate_is_to_be_refined_a_foundation_learns_nothing(completed, foundation):
    problem, result = completed
    assert _learnable(problem, result) == (result.on_model & ~result.on_rim).sum() > 0
    assert _learnable(SimpleNamespace(model=foundation), result) == 0


def test_a_frame_that_the_optimiser_missed_is_solved_from_the_pose_of_the_contact_model(knee, foundation, monkeypatch):
    cycle = reference_cycle(frames=9)
    problem = pose_estimation.build(knee, cycle)
    best = pose_estimation.solve(problem)
    with monkeypatch.context() as unsettled:
        unsettled.setattr(import_module("problems.pose_estimation.solve"), "settled", lambda problem, poses: poses)
        missed = pose_estimation.solve(problem, problem.start_poses(), max_iterations=3, alone=False)
    assert not missed.converged.any()
    result = complete(problem, missed, foundation)
    assert result.converged.all()
    assert not result.on_model.any()
    assert set(result.reason) == {"not found at first: solved from the pose of the contact model"}
    np.testing.assert_allclose(result.poses, best.poses, atol=1e-4)


def test_any_contact_model_serves_and_a_frame_without_load_has_no_centre_of_pressure(knee):
    """The surrogate itself as the contact model, which has no elements and no edge."""
    cycle = reference_cycle(frames=5)
    unloaded = np.arange(5) == 2
    problem = pose_estimation.build(
        knee, replace(cycle, fy_med=np.where(unloaded, 0.0, cycle.fy_med), fy_lat=np.where(unloaded, 0.0, cycle.fy_lat))
    )
    missed = pose_estimation.solve(problem, problem.start_poses(), max_iterations=3, alone=False)
    result = complete(problem, missed, knee)
    np.testing.assert_array_equal(result.converged, ~unloaded)
    assert result.reason[2] == missed.reason[2] == "no load: any pose out of contact carries it"
    assert not result.on_rim.any()


def test_a_frame_without_load_counts_for_nothing_in_a_verdict_and_in_random_starts(knee, foundation):
    cycle = reference_cycle(frames=5)
    unloaded = np.arange(5) == 2
    lifted = replace(cycle, fy_med=np.where(unloaded, 0.0, cycle.fy_med), fy_lat=np.where(unloaded, 0.0, cycle.fy_lat))
    problem = pose_estimation.build(knee, lifted)
    found = estimated(problem, None, foundation)
    assert found.verdict.exit_code == 0
    assert found.verdict.words[2] == "no load"
    assert not replace(found.verdict, errors=np.full_like(found.verdict.errors, 1e3)).differs[2]
    assert str(found.verdict) == "4 of 4 solved and verified on EF 80×40, 1 bear no load"
    starts = solve_from_random_starts(ContactSource("knee"), problem, found.result.poses, 1)
    assert (starts.solved, starts.reached) == (1, 1)


def test_a_surrogate_that_has_no_such_pose_inside_its_range_is_told(knee, foundation):
    """Its medial root load is the same in every pose, so that no pose has the measured one."""
    networks = dict(knee.networks)
    name = next(name for name in networks if "root" in name and "med" in name)
    networks[name] = replace(networks[name], output_scale=0.0 * networks[name].output_scale)
    problem = pose_estimation.build(
        type(knee)(knee.scene, networks, knee.record, knee.trust), reference_cycle(frames=5)
    )
    result = complete(problem, pose_estimation.solve(problem, alone=False), foundation)
    assert result.on_model.all()
    assert {reason.partition(": ")[2] for reason in result.reason} == {
        "inside the learned range, where the surrogate has no such pose"
    }


def test_settling_alone_misses_poses_near_the_rim_that_following_finds(foundation, knee):
    cycle = swing(26.0)
    problem = pose_estimation.build(knee, cycle)
    first = pose_estimation.solve(problem, alone=False)
    left = ~first.converged
    targets = {name: curve[left] for name, curve in cycle.targets().items()}
    _, alone = settle(foundation, first.poses[left], FREE, targets, tolerance=0.01)
    found = search(foundation, problem, first.poses, first.converged, left, None)
    assert not alone.converged.all()
    assert found.found.all()


def test_no_pose_has_a_centre_of_pressure_beyond_its_proven_reach(foundation):
    """Of 300 poses with contact none exceeds it; were their centres of pressure 1.6 times as far, some would."""
    rng = np.random.default_rng(5)
    low, high = np.array([-16.0, 26.0, -8.0, -0.1, -0.3, -1.5]), np.array([20.0, 32.0, 8.0, 0.1, 0.3, 0.3])
    poses, _ = settle(foundation, rng.uniform(low, high, (300, 6)), ("ty", "rx"), {"Fy_med": -300.0, "Fy_lat": -200.0})
    loads = foundation(poses)
    med, lat, tx, tz = (loads[:, foundation.load_names.index(name)] for name in LOADS)
    ok = (med < -1.0) & (lat < -1.0)
    assert ok.sum() > 200
    place = np.column_stack([tz, -tx])[ok] / (med + lat)[ok, None]
    frames = replace(
        reference_cycle(frames=int(ok.sum())),
        fy_med=med[ok],
        fy_lat=lat[ok],
        cop_ap_mm=place[:, 0],
        cop_ml_mm=place[:, 1],
    )

    def beyond(cycle):
        return beyond_reach_mm(foundation, WantedLoads.of(foundation.scene, cycle.wanted())).max()

    assert beyond(frames) == 0.0
    farther = replace(frames, cop_ap_mm=1.6 * frames.cop_ap_mm)
    assert beyond(farther) > 0.0
    assert beyond(replace(frames, fy_med=0.0 * med[ok], fy_lat=0.0 * lat[ok])) == 0.0


def test_smoothness_couples_frames_and_leaves_the_result_as_it_is(knee, foundation):
    problem = pose_estimation.build(knee, reference_cycle(frames=5), smoothness=1e6)
    result = pose_estimation.solve(problem)
    assert complete(problem, result, foundation) is result


def light(force_n):
    """Five frames of one flexion with 300 N on the medial side, but so many in the inner three; and which these are."""
    inner = np.array([False, True, True, True, False])
    medial = np.where(inner, -force_n, -300.0)
    at = {"ry": 0.03, "rz": -0.4, "cop_ap_mm": 1.0, "cop_ml_mm": 2.0}
    curves = {name: np.full(5, value) for name, value in at.items()}
    return replace(reference_cycle(frames=5), **curves, fy_med=medial, fy_lat=0.6 * medial), inner


@pytest.mark.parametrize("force_n", [0.1, 0.02])
def test_light_frames_have_their_centre_of_pressure_on_the_contact_model(knee, force_n):
    cycle, inner = light(force_n)
    problem, teacher = pose_estimation.build(knee, cycle), cc.ElasticFoundation(knee.scene, knee.scene.grids["teacher"])
    result = solve_and_complete(problem, None, teacher)
    assert result.converged.all(), result.reason
    assert result.on_model[inner].any()
    assert np.abs(result.errors[:, 2:]).max() <= 0.1  # mm


def test_a_frame_is_on_the_contact_model_only_where_it_carries_what_is_wanted(knee, foundation, monkeypatch):
    """Settled to 0.01 N alone, a tenth of a newton is a few tenths of a millimetre beside its place."""
    monkeypatch.setattr(WantedLoads, "settled_n", np.full(5, 0.01), raising=False)
    cycle, inner = light(0.1)
    problem = pose_estimation.build(knee, cycle)
    missed = pose_estimation.solve(problem, alone=False)
    result = complete(problem, missed, foundation)
    left = inner & ~result.converged
    assert left.any()
    assert not result.on_model[left].any()
    for frame in np.flatnonzero(left):
        assert result.reason[frame].startswith("no equilibrium on the contact model, from ")
        assert "at the nearest forces off by" in result.reason[frame]
    np.testing.assert_array_equal(result.poses[left], missed.poses[left])


def test_a_load_that_is_zero_but_for_rounding_is_no_load(knee, foundation):
    cycle, inner = light(1e-13)
    problem = pose_estimation.build(knee, cycle)
    result = solve_and_complete(problem, None, foundation)
    np.testing.assert_array_equal(result.converged, ~inner)
    assert set(result.reason[inner]) == {"no load: any pose out of contact carries it"}
