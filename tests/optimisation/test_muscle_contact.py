"""Muscle and contact together: balance, optimality, co-contraction, measured contact forces."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES, angular_velocity_map
from casadi_contact.optimisation.ipopt import FrameOutcome
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS, contact_on_femur, in_newtons
from casadi_contact.optimisation.muscle_contact import MuscleContact, MuscleSettings, ankle_moment
from casadi_contact.scenes.cycle import read_cycle
from problems.walks import example_walk, read_walk
from tests.support.shared_data import shared_file

WALK = example_walk(frames=5)
LEAST_SQUARES = {"exponent": 2.0, "margin_mm": 0.0, "share_heads": False, "ankle": False}


@pytest.fixture(scope="module")
def least_squares(knee):
    """The least squared activation and nothing else."""
    problem = MuscleContact(knee, example_walk(), MuscleSettings(**LEAST_SQUARES))
    return problem, problem.solve()


@pytest.fixture(scope="module")
def solved(knee):
    """As the program solves it."""
    problem = MuscleContact(knee, example_walk())
    return problem, problem.solve()


def on_femur(poses, loads):
    """`contact_on_femur` (n,) by coordinate."""
    q, w = ca.MX.sym("q", 6), ca.MX.sym("w", 7)
    function = ca.Function("f", [q, w], [ca.vertcat(*contact_on_femur(q, w).values())])
    return dict(zip(COORDINATES, function.map(len(poses))(poses.T, loads.T).full(), strict=True))


def compression(result):
    return -result.loads[:, :2]


def test_every_frame_balances_and_nothing_pulls(solved, least_squares):
    for problem, result in (solved, least_squares):
        assert result.solved.all()
        for name, left in result.unbalanced.items():
            assert np.abs(left).max() * in_newtons(name) < 0.01
        assert result.activations.min() >= 0.01 - 1e-7
        assert compression(result).min() >= 0.0
        pull = (problem.walk.arms["knee_ty"] * result.muscle_forces_n).sum(axis=1)
        np.testing.assert_allclose(compression(result).sum(axis=1), problem.walk.loads["knee_ty"] - pull, atol=0.1)


def test_the_activations_are_optimal(knee, least_squares):
    """A reserve r of size c tells the price λ = 2r/c² of its coordinate. A free activation costs what it saves,
    2a = Σ λ·arm·(force per activation), one at its bound costs more. Moving the femur saves nothing,
    Σ λ·d(contact)/d(ty, rx) = 0, where both sides carry load."""
    problem, result = least_squares
    walk, poses, sizes = problem.walk, result.poses, problem.settings.reserve_sizes
    price = {name: 2.0 * curve / sizes[name] ** 2 for name, curve in result.reserves.items()}
    saved = sum(price[name][:, None] * walk.arms[name] * problem.active_n for name in price)
    surplus, free = 2.0 * result.activations - saved, result.activations > 0.011
    assert free.sum() > 300
    assert np.abs(surplus[free]).max() < 1e-3
    assert surplus[~free].min() > -1e-3
    loaded = compression(result).min(axis=1) > 20.0
    for name, step in (("ty", 1e-5), ("rx", 1e-6)):
        moves = np.zeros(6)
        moves[POSE_NAMES.index(name)] = step
        ahead, behind = (on_femur(p, knee(p, KNEE_LOADS)) for p in (poses + moves, poses - moves))
        gains = np.array([price[c] * (ahead[c] - behind[c]) / (2.0 * step) for c in price])
        assert np.abs(gains.sum(axis=0))[loaded].max() < 1e-4 * np.abs(gains).max()


def test_all_six_coordinates_balance_with_reserves(knee):
    settings = MuscleSettings(**LEAST_SQUARES, balanced=tuple(COORDINATES), free=("tx", "ty", "tz", "rx"))
    result = MuscleContact(knee, example_walk(frames=21), settings).solve()
    assert (result.outcome != FrameOutcome.NOT_SOLVED).all()
    assert max(np.abs(curve).max() * in_newtons(name) for name, curve in result.unbalanced.items()) < 0.01


def test_a_generalised_load_does_the_work_of_its_forces():
    """Σ F·v of forces at points of the femur = Σ Q·(pose rate)."""
    rng = np.random.default_rng(3)
    pose, rate = rng.normal(size=6), rng.normal(size=6)
    points, forces = rng.normal(size=(2, 5, 3)) * np.array([30.0, 100.0])[:, None, None]
    moment = np.cross(points, forces).sum(axis=0)
    fx, fy, fz = -forces.sum(axis=0)  # on the tibia
    loads = np.array([0.3 * fy, 0.7 * fy, fx, fz, *(-moment)])
    omega = angular_velocity_map(pose[3:]) @ rate[3:]
    power = (forces * (rate[:3] + np.cross(omega, points - pose[:3]))).sum()
    found = on_femur(pose[None], loads[None])
    metres = [1.0 if parameter.startswith("t") else 1000.0 for parameter in COORDINATES.values()]
    assert np.dot([found[name][0] for name in COORDINATES], np.array(metres) * rate) == pytest.approx(power)


def test_heads_share_an_activation_and_both_sides_stay_closed(solved):
    problem, result = solved
    names, a = problem.walk.muscles.names, result.activations
    for one, other in (("vasint", "vaslat"), ("vasint", "vasmed"), ("gasmed", "gaslat")):
        np.testing.assert_allclose(a[:, names.index(one)], a[:, names.index(other)], atol=1e-6)
    least = np.maximum(problem.walk.loads["knee_ty"], 0.0) * 20.0 / 44.0  # N = knee_ty·Δ/w
    assert (compression(result) - least[:, None]).min() > -0.5
    assert np.abs(compression(result) - least[:, None]).min() < 0.5, "the margin holds somewhere"


def test_the_calf_carries_the_ankle_s_moment_from_the_knee_s_inverse_dynamics(solved):
    problem, result = solved
    walk, settings = problem.walk, problem.settings
    moment = ankle_moment(walk, 0.41)
    np.testing.assert_allclose(moment, 0.41 * walk.loads["knee_tx"] - walk.loads["knee_flexion"])
    gastrocnemius = result.muscle_forces_n[:, [walk.muscles.names.index(n) for n in ("gasmed", "gaslat")]].sum(axis=1)
    calf = 0.045 * (gastrocnemius + settings.soleus_n * result.soleus)
    assert (calf - moment).min() > -0.01
    pushing = moment > 20.0
    assert pushing.any()
    np.testing.assert_allclose(calf[pushing], moment[pushing], atol=0.01)


def test_a_load_beyond_the_muscles_falls_to_the_reserves(knee):
    loads = {**WALK.loads, "knee_flexion": WALK.loads["knee_flexion"] + 600.0}
    result = MuscleContact(knee, replace(WALK, loads=loads)).solve()
    assert (result.outcome == FrameOutcome.OVERLOADED).all()
    assert result.activations.max(axis=1).min() > 0.999
    assert result.reserves["knee_flexion"].min() > 300.0


@pytest.mark.parametrize(
    ("settings", "walk", "word"),
    [
        ({"balanced": ("knee_ty", "hip")}, WALK, "balanced"),
        ({"free": ("ty",)}, WALK, "rx"),
        ({"exponent": 1.0}, WALK, "exponent"),
        ({"margin_mm": 50.0}, WALK, "margin"),
        ({"shank_m": 41.0}, WALK, "shank"),
        ({}, replace(WALK, muscles=replace(WALK.muscles, names=tuple("abcdefghijklm"))), "vas"),
        ({}, replace(WALK, rz=WALK.rz - 2.0), "learned"),
    ],
)
def test_wrong_requests_are_refused(knee, settings, walk, word):
    with pytest.raises(ValueError, match=word):
        MuscleContact(knee, walk, MuscleSettings(**settings))
    with pytest.raises(ValueError, match="two sides"):
        MuscleContact(cc.ElasticFoundation(cc.load_scene("planar_knee"), (8, 8)), WALK)


@pytest.mark.parametrize(
    ("name", "settings", "expected"),
    [(f"og{k}", {}, None) for k in (1, 2, 3, 4)] + [("og1", LEAST_SQUARES, (88.6, 300.1))],
)
def test_measured_cycles_are_predicted_without_their_contact_forces(knee, name, settings, expected):
    """Winners of the knee Grand Challenges: 229 to 312 N medial, 238 to 326 N lateral."""
    files = (f"{name}_loads", f"{name}_inverse_dynamics", f"{name}_muscles", "muscle_parameters")
    walk = read_walk(*(shared_file(f"data/jw/{file}.csv") for file in files))
    problem = MuscleContact(knee, walk, MuscleSettings(**settings))
    result = problem.solve()
    assert result.solved.all()
    measured = read_cycle(shared_file(f"data/jw/{name}_loads.csv"))
    forces = [np.interp(problem.walk.time_s, measured.time_s, -curve) for curve in measured.loads.values()]
    errors = np.sqrt(np.mean((compression(result) - np.column_stack(forces)) ** 2, axis=0))
    if expected:
        np.testing.assert_allclose(errors, expected, atol=1.0)
    else:
        assert (errors < [90.0, 200.0]).all()
