"""Muscle and contact together: balance, golden numbers, optimality, co-contraction, mistakes."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES, angular_velocity_map
from casadi_contact.optimisation.knee import COORDINATES, KNEE_LOADS, contact_expression, contact_on_femur, in_newtons
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.scenes.opensim.table import read_opensim_table
from problems import muscle_contact
from problems.muscle_contact import __main__
from problems.muscle_contact.cocontraction import CALF_ARM_M, SOLEUS_N, ankle_moment
from problems.muscle_contact.problem import BALANCED, LEAST_SQUARES, MARGIN_MM, RESERVE_SIZES
from tests.support.command import ended, ran

SIX = {"balanced": tuple(COORDINATES), "free": ("tx", "ty", "tz", "rx"), **LEAST_SQUARES}


@pytest.fixture(scope="module")
def solved(knee):
    """The least squared activation and nothing else."""
    problem = muscle_contact.build(knee, example_walk(), **LEAST_SQUARES)
    return problem, muscle_contact.solve(problem)


@pytest.fixture(scope="module")
def cocontracting(knee):
    """As the command solves it."""
    problem = muscle_contact.build(knee, example_walk())
    return problem, muscle_contact.solve(problem)


def compression(result):
    return -result.loads[:, : len(("Fy_med", "Fy_lat"))]


def test_every_frame_of_the_example_balances_and_nothing_pulls(solved):
    problem, result = solved
    assert result.converged.all(), result.reason
    for name in problem.balanced:
        assert np.abs(result.unbalanced[name]).max() * in_newtons(name) < 0.01
        assert np.abs(result.reserves[name]).max() * in_newtons(name) < 2.0
    assert result.activations.min() >= 0.01 - 1e-7
    assert result.activations.max() <= 1.0
    assert compression(result).min() >= 0.0
    assert not result.overloaded.any()


def test_total_compression_is_the_ground_s_push_and_the_muscles_pull(solved):
    problem, result = solved
    pull = (problem.walk.arms["knee_ty"] * result.muscle_forces_n).sum(axis=1)
    np.testing.assert_allclose(compression(result).sum(axis=1), problem.walk.loads["knee_ty"] - pull, atol=0.1)


def test_the_example_has_its_golden_forces_and_activations(solved):
    _, result = solved
    golden = json.loads((Path(__file__).parent / "golden_muscle_contact.json").read_text())
    for frame, numbers in golden.items():
        np.testing.assert_allclose(compression(result)[int(frame)], numbers["compression_n"], atol=1.0)
        np.testing.assert_allclose(result.activations[int(frame)], numbers["activations"], atol=1e-3)


def test_the_elastic_foundation_agrees_at_the_solved_poses(solved):
    problem, result = solved
    scene = problem.contact_model.scene
    columns = [scene.load_names.index(name) for name in KNEE_LOADS[:2]]
    foundation = cc.ElasticFoundation(scene, scene.grids["teacher"])(result.poses)[:, columns]
    assert np.sqrt(np.mean((foundation - result.loads[:, :2]) ** 2)) < 1.0


def test_the_activations_are_optimal(knee, solved):
    """The optimality conditions, from the surrogate's NumPy side: a reserve r of size c tells the price λ = 2r/c² of
    its coordinate; a free activation costs what it saves, 2a = Σ λ·arm·(force per activation), one at its bound costs
    more; and moving the femur saves nothing, Σ λ·d(contact)/d(ty, rx) = 0, where both sides carry load."""
    problem, result = solved
    walk, capacity, poses = problem.walk, problem.capacity, result.poses
    price = {name: 2.0 * result.reserves[name] / RESERVE_SIZES[name] ** 2 for name in problem.balanced}
    saved = sum(price[name][:, None] * walk.arms[name] * capacity.active_n for name in problem.balanced)
    surplus = 2.0 * result.activations - saved
    free = result.activations > 0.011
    assert free.sum() > 300
    assert np.abs(surplus[free]).max() < 1e-3
    assert surplus[~free].min() > -1e-3
    loaded = compression(result).min(axis=1) > 20.0
    for name, step in (("ty", 1e-5), ("rx", 1e-6)):
        moves = np.zeros(6)
        moves[POSE_NAMES.index(name)] = step
        ahead, behind = (contact_on_femur(p, knee(p, KNEE_LOADS)) for p in (poses + moves, poses - moves))
        gains = np.array([price[c] * (ahead[c] - behind[c]) / (2.0 * step) for c in problem.balanced])
        assert np.abs(gains.sum(axis=0))[loaded].max() < 1e-4 * np.abs(gains).max()


def test_muscles_twice_as_strong_are_half_as_active(knee):
    walk = example_walk(frames=21)
    strong = replace(walk.muscles, max_isometric_force_n=2.0 * walk.muscles.max_isometric_force_n)
    settings = {**LEAST_SQUARES, "model": "isometric", "least_activation": 0.0}
    once, twice = (
        muscle_contact.solve(muscle_contact.build(knee, replace(walk, muscles=muscles), **settings))
        for muscles in (walk.muscles, strong)
    )
    np.testing.assert_allclose(2.0 * twice.activations, once.activations, atol=0.01)
    np.testing.assert_allclose(compression(twice), compression(once), atol=3.0)


def test_all_six_coordinates_balance_with_reserves(knee):
    problem = muscle_contact.build(knee, example_walk(frames=21), **SIX)
    result = muscle_contact.solve(problem)
    assert result.converged.all(), result.reason
    assert max(np.abs(curve).max() * in_newtons(name) for name, curve in result.unbalanced.items()) < 0.01


def test_a_generalised_load_does_the_work_of_its_forces():
    """Σ F·v of forces at points of the femur = Σ Q·(pose rate), and the CasADi expression says the same."""
    rng = np.random.default_rng(3)
    pose, rate = rng.normal(size=6), rng.normal(size=6)
    points, forces = rng.normal(size=(2, 5, 3)) * np.array([30.0, 100.0])[:, None, None]
    moment = np.cross(points, forces).sum(axis=0)
    fx, fy, fz = -forces.sum(axis=0)  # on the tibia
    loads = np.array([0.3 * fy, 0.7 * fy, fx, fz, *(-moment)])
    omega = angular_velocity_map(pose[3:]) @ rate[3:]
    power = (forces * (rate[:3] + np.cross(omega, points - pose[:3]))).sum()
    on_femur = contact_on_femur(pose[None], loads[None])
    metres = [1.0 if parameter.startswith("t") else 1000.0 for parameter in COORDINATES.values()]
    assert np.dot([on_femur[name][0] for name in COORDINATES], np.array(metres) * rate) == pytest.approx(power)
    q, w = ca.MX.sym("q", 6), ca.MX.sym("w", 7)
    expression = ca.Function("f", [q, w], [ca.vertcat(*contact_expression(q, w).values())])
    expected = [on_femur[name][0] for name in COORDINATES]
    np.testing.assert_allclose(np.asarray(expression(pose, loads)).ravel(), expected, rtol=1e-12)


def test_heads_share_an_activation_and_both_sides_stay_closed(cocontracting):
    problem, result = cocontracting
    assert result.converged.all(), result.reason
    names, a = problem.walk.muscles.names, result.activations
    for one, other in (("vasint", "vaslat"), ("vasint", "vasmed"), ("gasmed", "gaslat")):
        np.testing.assert_allclose(a[:, names.index(one)], a[:, names.index(other)], atol=1e-6)
    least = np.maximum(problem.walk.loads["knee_ty"], 0.0) * MARGIN_MM / 44.0
    assert (compression(result) - least[:, None]).min() > -0.5
    assert np.abs(compression(result) - least[:, None]).min() < 0.5, "the margin holds somewhere"


def test_the_load_may_pass_the_margin_beside_its_place_without_opening_a_side(knee, cocontracting):
    """Move the ground's push so far to the medial side: contact alone takes it, and still pushes on both sides."""
    problem, result = cocontracting
    frame = int(compression(result)[:, 1].argmin())
    push = max(problem.walk.loads["knee_ty"][frame], 0.0)
    shifted = compression(result)[frame] + push * MARGIN_MM / 44.0 * np.array([1.0, -1.0])
    assert shifted.min() > -0.5


def test_the_calf_carries_the_ankle_s_moment_from_the_knee_s_inverse_dynamics(cocontracting):
    problem, result = cocontracting
    walk = problem.walk
    moment = ankle_moment(walk)
    np.testing.assert_allclose(moment, 0.41 * walk.loads["knee_tx"] - walk.loads["knee_flexion"])
    gastrocnemius = result.muscle_forces_n[:, [walk.muscles.names.index(n) for n in ("gasmed", "gaslat")]].sum(axis=1)
    calf = CALF_ARM_M * (gastrocnemius + SOLEUS_N * result.soleus)
    assert (calf - moment).min() > -0.01
    assert moment.max() > 20.0
    pushing = moment > 20.0
    np.testing.assert_allclose(calf[pushing], moment[pushing], atol=0.01)


def test_rules_that_find_no_muscle_or_load_say_so(knee):
    walk = example_walk(frames=5)
    names = tuple(f"muscle_{k}" for k in range(len(walk.muscles.names)))
    strange = replace(walk, muscles=replace(walk.muscles, names=names))
    with pytest.raises(ValueError, match="no heads of a vastus or gastrocnemius"):
        muscle_contact.build(knee, strange)
    with pytest.raises(ValueError, match="no gastrocnemius, leave the ankle out"):
        muscle_contact.build(knee, strange, share_heads=False)
    loads = {name: walk.loads[name] for name in BALANCED}
    planar = replace(walk, loads=loads, arms={name: walk.arms[name] for name in BALANCED})
    with pytest.raises(
        ValueError,
        match=r"has no loads and arms of knee_tx; .* give knee_tx_N in .* and arm_knee_tx of .* leave the ankle out",
    ):
        muscle_contact.build(knee, planar)


def test_a_load_beyond_the_muscles_falls_to_the_reserves_and_is_seen(knee):
    walk = example_walk(frames=5)
    loads = {**walk.loads, "knee_flexion": walk.loads["knee_flexion"] + 600.0}
    result = muscle_contact.solve(muscle_contact.build(knee, replace(walk, loads=loads)))
    assert result.converged.all()
    assert result.overloaded.all()
    assert result.activations.max(axis=1).min() > 0.999
    assert result.reserves["knee_flexion"].min() > 300.0


def test_further_cycles_of_a_person_count_in_the_scaling(knee):
    walk = example_walk(frames=5)
    alone = muscle_contact.build(knee, walk)
    within = muscle_contact.build(knee, walk, other_lengths_m=walk.lengths_m[1:3])
    longer = muscle_contact.build(knee, walk, other_lengths_m=1.1 * walk.lengths_m)
    np.testing.assert_array_equal(within.capacity.fibre, alone.capacity.fibre)
    assert longer.capacity.fibre.max() < 1.1 < alone.capacity.fibre.max()


def test_a_problem_can_be_inspected_unsolved_and_stopped_early(knee):
    problem = muscle_contact.build(knee, example_walk(frames=5))
    assert problem.nlp["x"].numel() == 5 * (13 + 2 + 3 + 1) == len(problem.start)
    assert problem.nlp["g"].numel() == 5 * (3 + 2 + 3 + 1) == len(problem.upper_g)
    result = muscle_contact.solve(problem, max_iterations=1)
    assert not result.converged.any()
    assert "IPOPT stopped: Maximum_Iterations_Exceeded" in result.reason[0]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"balanced": ("knee_ty", "hip")}, "hip"),
        ({"balanced": ("knee_ty", "knee_ty")}, "each named once"),
        ({"balanced": ("knee_ty", "knee_flexion")}, "rx is free, but nothing balanced moves along it"),
        ({"free": ("ty",)}, "expected ty and rx"),
        ({"exponent": 1.0}, "exponent is 1.0"),
        ({"exponent": np.inf}, "exponent is inf"),
        ({"least_activation": 1.0}, "least activation 1.0"),
        ({"margin_mm": 50.0}, "margin is 50.0 mm"),
        ({"shank_m": 41.0}, "shank is 41.0 m long"),
        ({"model": "elastic"}, "muscle model is 'elastic'"),
    ],
)
def test_wrong_requests_are_refused(knee, settings, said):
    with pytest.raises(ValueError, match=said):
        muscle_contact.build(knee, example_walk(frames=5), **settings)


def test_rotations_outside_the_learned_range_are_refused(knee):
    walk = example_walk(frames=5)
    with pytest.raises(ValueError, match=r"rz reaches from .* the surrogate learned"):
        muscle_contact.build(knee, replace(walk, rz=walk.rz - 2.0))


def test_the_command_writes_table_csv_opensim_files_summary_and_picture(tmp_path, cocontracting):
    done = ran("problems.muscle_contact", "--out", tmp_path / "results")
    assert done.returncode == 0, done.stderr
    assert "101 of 101 frames converged" in done.stdout
    _, result = cocontracting
    rows = list(csv.DictReader((tmp_path / "results" / "muscle_contact.csv").open()))
    assert float(rows[17]["soleus_activation"]) == pytest.approx(result.soleus[17], abs=1e-3)
    assert float(rows[17]["Fy_med_N"]) == pytest.approx(-compression(result)[17, 0], abs=0.01)
    poses = read_opensim_table(tmp_path / "results" / "poses.sto")
    np.testing.assert_allclose(1000.0 * poses.column("ty"), result.poses[:, 1], atol=1e-6)
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    assert summary["converged"] == 101
    assert summary["errors_n"]["Fy_med"]["teacher_ef"]["rms"] < 1.0
    assert (tmp_path / "results" / "muscle_contact.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--muscles", "m.csv"), "--inverse-dynamics, --parameters, --rotations not given"),
        (("--map", "knee_angle_r=-rz:deg"), "--rotations not given, expected all four files, or none and no --map"),
        (("--measured", "none.csv"), "cycle file none.csv does not exist"),
        (("--out", "/proc/nowhere"), "cannot write in folder /proc/nowhere"),
    ],
)
def test_a_mistake_is_one_line_and_a_nonzero_exit(arguments, said, monkeypatch, tmp_path):
    out = () if "--out" in arguments else ("--out", str(tmp_path))
    message = ended(monkeypatch, __main__.main, *arguments, *out)  # Python prints it on stderr, and exits with status 1
    assert said in message
    assert len(message.splitlines()) == 1
