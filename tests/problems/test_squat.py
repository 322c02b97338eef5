"""The planar leg's equations against Lagrange's and statics, the transcription, and the trade-off of the squat."""

import csv
import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import Rays
from casadi_contact.optimisation.collocation import Collocation
from casadi_contact.verification import judge
from problems import squat
from problems.squat import __main__
from problems.squat.leg import GRAVITY
from problems.squat.muscles import MUSCLES, column
from problems.squat.problem import LEAST_ACTIVATION, flexion_rad
from problems.squat.report import draw, report
from problems.squat.solve import start_values
from tests.support.command import ended
from tests.support.compiler import needs_compiler

BODY = squat.Body()
ZERO = np.zeros(3)
DROPPED = np.zeros(len(MUSCLES))


@pytest.fixture(scope="module")
def mechanics():
    return squat.LegMechanics.of(BODY)


def lagrange(phi, rate, bend):
    """d/dt ∂L/∂φ̇ - ∂L/∂φ of three rods with masses, by CasADi's own derivatives."""
    q, v = ca.SX.sym("q", 3), ca.SX.sym("v", 3)
    energy, x, y = 0.0, 0.0, 0.0
    for i in range(3):
        centre, length = BODY.centres_m[i], BODY.lengths_m[i]
        at = ca.vertcat(x + centre * ca.sin(q[i]), y + centre * ca.cos(q[i]))
        speed = ca.jtimes(at, q, v)
        kinetic = 0.5 * BODY.masses_kg[i] * ca.sumsqr(speed) + 0.5 * BODY.inertias_kgm2[i] * v[i] ** 2
        energy += kinetic - BODY.masses_kg[i] * GRAVITY * at[1]
        x, y = x + length * ca.sin(q[i]), y + length * ca.cos(q[i])
    momentum = ca.gradient(energy, v)
    changing = ca.jtimes(momentum, q, v) + ca.mtimes(ca.jacobian(momentum, v), ca.SX(bend))
    return np.array(ca.Function("lagrange", [q, v], [changing - ca.gradient(energy, q)])(phi, rate))[:, 0]


def lengths(phi):
    """Musculotendon lengths (m) [m]."""
    dorsiflexion, flexion, hip = phi[0], phi[0] - phi[1], phi[2] - phi[1]
    return column("length_m") - (column("hip_m") * hip - column("knee_m") * flexion + column("ankle_m") * dorsiflexion)


def test_motion_follows_lagrange_with_the_muscles_virtual_work(mechanics):
    """Q_i = -Σ F·∂length/∂φ_i."""
    draw = np.random.default_rng(4)
    for _ in range(5):
        phi, rate, bend = draw.uniform(-0.8, 0.8, 3), draw.uniform(-2.0, 2.0, 3), draw.uniform(-5.0, 5.0, 3)
        a = draw.uniform(0.0, 1.0, len(MUSCLES))
        forces = np.array(mechanics.muscle_forces(phi, rate, a))[:, 0]
        arms = np.array([(lengths(phi + step) - lengths(phi - step)) / 2e-6 for step in 1e-6 * np.eye(3)])
        motion = np.array(mechanics.residuals(phi, rate, bend, a, np.zeros(6), np.zeros(6))[0])[:, 0]
        np.testing.assert_allclose(motion, lagrange(phi, rate, bend) + arms @ forces, rtol=1e-6, atol=1e-6)


def passive(mechanics, phi):
    return np.array(mechanics.muscle_forces(phi, ZERO, DROPPED))[:, 0]


def test_contact_under_an_upright_body_carries_what_is_above_the_knee(mechanics):
    """Upright and at rest: thigh, trunk and the pull of the muscles that cross the knee press along the shank."""
    phi = np.zeros(3)
    forces = passive(mechanics, phi)
    above = GRAVITY * BODY.masses_kg[1:].sum()
    crossing = [k for k, muscle in enumerate(MUSCLES.values()) if muscle.along is not None]
    left = mechanics.residuals(phi, ZERO, ZERO, DROPPED, np.zeros(6), np.zeros(6))[1]
    tendon = forces[[k for k, m in enumerate(MUSCLES.values()) if m.along == "quadriceps"]].sum()
    down = above + forces[crossing].sum() - tendon * (1.0 - np.cos(np.radians(20.0)))
    assert float(left[1]) == pytest.approx(-down, rel=1e-12)
    assert float(left[0]) == pytest.approx(tendon * np.sin(np.radians(20.0)), rel=1e-9)


def test_the_ground_carries_the_body_and_its_push_is_where_moments_say(mechanics):
    """At rest the ground force is the weight; without muscles the centre of pressure is under the ankle."""
    _, _, ground, within = mechanics.residuals(ZERO, ZERO, ZERO, DROPPED, np.zeros(6), np.zeros(6))
    weight = GRAVITY * BODY.masses_kg.sum()
    np.testing.assert_allclose(np.array(ground)[:, 0], [0.0, weight], atol=1e-9)
    ankle = column("ankle_m") @ passive(mechanics, ZERO)
    expected = [-ankle - BODY.heel_m * weight, BODY.toe_m * weight + ankle]
    np.testing.assert_allclose(np.array(within)[:, 0], expected, rtol=1e-9)


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
def test_collocation_is_exact_for_polynomials_of_its_degree(scheme):
    grid = Collocation(4, 3, 2.0, scheme)
    curve = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.7])
    nodes, times = ca.MX(curve(np.linspace(0.0, 2.0, 5))[None]), grid.times_s
    points = ca.MX(curve(times)[None])
    slopes, jumps = (
        np.array(ca.evalf(part)) for part in (grid.derivatives(nodes, points) / grid.step_s, grid.jumps(nodes, points))
    )
    np.testing.assert_allclose(slopes[0], curve.deriv()(times), atol=1e-12)
    np.testing.assert_allclose(jumps, 0.0, atol=1e-12)
    assert grid.weights @ curve(times) == pytest.approx(curve.integ()(2.0) / 2.0, rel=1e-12)


@pytest.fixture(scope="module")
def small():
    model = cc.PolarFoundation(cc.load_scene("knee"), Rays(12, 3))
    return squat.build(model, intervals=6)


@pytest.fixture(scope="module")
def results(small):
    return squat.trade_off(small, [0.01, 0.3])


def test_the_hessian_of_the_lagrangian_is_that_of_differenced_gradients():
    """On a surrogate, whose own Hessian is exact."""
    problem = squat.build(cc.load_surrogate("knee"), intervals=2, depth_deg=60.0)
    x, w = problem.nlp["x"], problem.nlp["p"]
    draw = np.random.default_rng(2)
    multipliers = ca.DM(draw.standard_normal(problem.nlp["g"].numel()))
    lagrangian = problem.nlp["f"] + ca.dot(multipliers, problem.nlp["g"])
    hessian, gradient = ca.hessian(lagrangian, x)
    values = ca.Function("values", [x, w], [hessian, gradient])
    at, direction = start_values(problem), draw.standard_normal(x.numel())
    step = 1e-6
    exact = np.array(values(at, 0.1)[0] @ direction)[:, 0]
    differenced = np.array(values(at + step * direction, 0.1)[1] - values(at - step * direction, 0.1)[1])[:, 0]
    np.testing.assert_allclose(exact, differenced / (2.0 * step), atol=1e-6 * np.abs(exact).max())


@needs_compiler
def test_a_squat_goes_to_its_depth_within_all_bounds_and_balances_across_the_knee(small, results):
    for r in results:
        assert r.solved, r.ipopt_status
        flexion = flexion_rad(r.time_s, 80.0, 3.0)
        np.testing.assert_allclose(-r.poses[:, 5], flexion, atol=1e-6)
        assert r.activations.min() > LEAST_ACTIVATION - 1e-6
        assert r.activations.max() < 1.0 + 1e-6
        np.testing.assert_allclose(small.model(r.poses), r.loads)
        assert (r.loads[:, :2] < 0.0).all()  # both sides carry


@needs_compiler
def test_more_weight_on_contact_lowers_the_medial_force_and_costs_activation(results):
    light, heavy = results
    assert heavy.medial_bw < 0.95 * light.medial_bw
    assert heavy.effort > 2.0 * light.effort
    # at the optimum of each, its own cost is lower there than at the other's
    for own, other in ((light, heavy), (heavy, light)):
        assert own.effort + own.weight * own.medial_bw**2 < other.effort + own.weight * other.medial_bw**2


@needs_compiler
def test_the_squat_costs_what_its_page_says(results):
    """Row 0.01 of docs/problems/squat.md; a quarter of its intervals changes it by less than 1 %."""
    light = results[0]
    assert light.effort == pytest.approx(0.00539, rel=0.02)
    assert light.medial_bw == pytest.approx(0.977, rel=0.01)
    assert -light.loads[:, 0].min() / BODY.weight_n == pytest.approx(1.32, rel=0.02)


@needs_compiler
def test_no_squat_of_a_trade_off_is_cheaper_at_the_weight_of_another(small):
    """Every squat is feasible at every weight, and so the optimum of a weight costs no more than any of them."""
    weights = [0.0, 0.001, 0.003, 0.01]
    found = squat.trade_off(small, weights)
    cost = ca.Function("cost", [small.nlp["x"], small.nlp["p"]], [small.nlp["f"]])
    costs = np.array([[float(cost(r.x, weight)) for r in found] for weight in weights])
    assert all(r.solved for r in found)
    assert (np.diag(costs) <= (1.0 + 1e-4) * costs.min(axis=1)).all()


@needs_compiler
def test_bounds_that_hold_a_squat_are_named_with_the_moments(results):
    """The search's reach of 15 mm along x, and the leans it allows, are no part of a leg."""
    assert results[1].at_bounds == ""
    poses, phi = results[1].poses.copy(), results[1].phi.copy()
    poses[:2, 0], phi[3, 0] = -14.9999, 0.8
    held = replace(results[1], poses=poses, phi=phi).at_bounds
    assert held == "shank lean at 45.8 degrees (1 of 18 moments), tx at -15 mm (2 of 18 moments)"


@needs_compiler
def test_the_table_and_its_file_say_which_bounds_hold(small, results, tmp_path, capsys):
    poses = results[0].poses.copy()
    poses[4, 0] = 15.0
    held = [replace(results[0], poses=poses), results[1]]
    stacked, model = np.vstack([r.poses for r in held]), cc.ElasticFoundation(small.model.scene, (40, 20))
    report(small, held, judge(small.model, stacked, np.ones(len(stacked), dtype=bool), model), model, tmp_path)
    assert "weight 0.01: the search's bounds hold tx at 15 mm (1 of 18 moments); the cost" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "squat.csv").open(encoding="utf-8")))
    assert [row["at_bounds"] for row in rows] == ["tx at 15 mm (1 of 18 moments)", ""]
    moments = list(csv.DictReader((tmp_path / "moments.csv").open(encoding="utf-8")))
    assert [int(row["frame"]) for row in moments] == list(range(36))  # the verdict's numbers run on over all weights


@needs_compiler
def test_the_picture_compares_least_and_largest_weight_in_whatever_order_they_are_given(
    small, results, tmp_path, monkeypatch
):
    pages = []
    monkeypatch.setattr("problems.squat.report.save_page", lambda page, *_, **__: pages.append(page))
    given = [replace(results[0], weight=weight) for weight in (0.1, 1.0, 0.0, 0.3)]
    draw(small, given, "no elements", tmp_path / "squat.png")
    bars = pages[0].axes[2].get_legend_handles_labels()[1]
    assert bars == ["weight 0", "weight 1"]
    assert [text.get_text() for text in pages[0].axes[0].texts] == [" 0", " 0.1", " 0.3", " 1"]


@needs_compiler
def test_muscles_that_pull_a_femur_against_the_search_s_bounds_are_not_blamed_alone(small, results, tmp_path, capsys):
    """On a flat tibia the femur slides; held by a bound it asks more of muscles than where it would come to rest."""
    poses, activations = results[0].poses.copy(), results[0].activations.copy()
    poses[4, 0], activations[4, 0] = -15.0, 1.0
    held = [replace(results[0], poses=poses, activations=activations, solved=False)]
    model = cc.ElasticFoundation(small.model.scene, (40, 20))
    report(small, held, judge(small.model, poses, np.zeros(len(poses), dtype=bool), model), model, tmp_path)
    said = capsys.readouterr().out
    assert "hold tx at -15 mm (1 of 18 moments); a squat may need to go beyond them, and muscles" in said


@needs_compiler
def test_a_body_too_heavy_for_its_muscles_is_not_solved_and_says_which_have_no_force_left(small, tmp_path, capsys):
    """Ten vasti of 7 kN at an arm of 42 mm could not hold half of 50 t, whatever the contact."""
    heavy = squat.build(small.model, squat.Body(mass_kg=50_000.0), intervals=4)
    found = squat.trade_off(heavy, [0.03])
    assert not found[0].solved
    assert "vasti" in found[0].exhausted
    model = cc.ElasticFoundation(heavy.model.scene, (40, 20))
    report(
        heavy,
        found,
        judge(heavy.model, found[0].poses, np.zeros(len(found[0].poses), dtype=bool), model),
        model,
        tmp_path,
    )
    said = capsys.readouterr().out
    assert f"weight 0.03: not solved, {found[0].ipopt_status}, where no force is left in " in said
    assert "ask less, by --depth, --mass or --duration" in said
    assert "could be lower beyond" not in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"depth_deg": 5.0}, "depth 5.0 deg"),
        ({"intervals": 1}, "intervals 1"),
        ({"body": {"mass_kg": 0.0}}, "mass 0.0 kg"),
        ({"body": {"height_m": np.inf}}, "height inf m"),
        ({"body": {"adduction_lever_mm": np.nan}}, "passes nan mm medially of the knee, expected -200 to 200 mm"),
        ({"duration_s": np.inf}, "inf s: expected a knee flexion"),
        ({"duration_s": 0.05}, "a time of 0.3 s or more"),
    ],
)
def test_wrong_requests_are_refused(small, given, said):
    with pytest.raises(ValueError, match=said):
        squat.build(small.model, squat.Body(**given.pop("body", {})), **given)


@needs_compiler
def test_the_command_writes_the_trade_off_and_its_picture(tmp_path, monkeypatch, capsys):
    assert ended(monkeypatch, __main__.main, "--intervals", 6, "--weights", "0.03,0.3", "--out", tmp_path) == 0
    assert "36 of 36 solved and verified on EF 320×160" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "squat.csv").open(encoding="utf-8")))
    assert [float(row["weight"]) for row in rows] == [0.03, 0.3]
    assert len(json.loads((tmp_path / "squat.json").read_text("utf-8"))["points"]) == 2
    assert (tmp_path / "squat.png").read_bytes().startswith(b"\x89PNG")


def test_a_mistake_is_one_line(tmp_path, monkeypatch):
    said = ended(monkeypatch, __main__.main, "--scene", "hip", "--out", tmp_path)
    assert said.startswith("squat: ")
    assert "\n" not in said
