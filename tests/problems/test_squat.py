"""The leg's mechanics by Lagrange and by a free body in the world's axes; a trade-off's order."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.muscle import rigid_tendon_forces
from problems import squat
from problems.squat import ANKLE_M, FRONTAL_M, GRAVITY, MUSCLES, Body

BODY = Body()
MASSES, LENGTHS, CENTRES, INERTIAS = BODY.segments


@pytest.fixture(scope="module")
def leg():
    return squat.leg(BODY)


@pytest.fixture(scope="module")
def muscles():
    phi, rates, a = ca.SX.sym("phi", 3), ca.SX.sym("rates", 3), ca.SX.sym("a", 10)
    return ca.Function("muscles", [phi, rates, a], [squat.muscle_forces(phi, rates, a)])


@pytest.fixture(params=range(3))
def moment(request, muscles):
    """φ, φ̇, φ̈, activations, pose of the knee, wrench on the insert [N, N·mm], and muscle forces [N]."""
    draw = np.random.default_rng(request.param)
    phi, rates, bend = draw.uniform(-0.8, 0.8, 3), draw.uniform(-2.0, 2.0, 3), draw.uniform(-5.0, 5.0, 3)
    a, pose = draw.uniform(0.0, 1.0, 10), np.array([3.0, 27.0, 0.0, 0.0, 0.0, phi[1] - phi[0]])
    wrench = np.array([120.0, -900.0, 35.0, 8000.0, -600.0, 4000.0])
    return phi, rates, bend, a, pose, wrench, np.array(muscles(phi, rates, a))[:, 0]


def left(leg, moment):
    return [np.array(part)[:, 0] for part in leg(*moment[:6])]


def centres(phi):
    """Centres of mass (3, 2), forward and up from the ankle [m], as CasADi expressions."""
    along = [ca.vertcat(ca.sin(phi[i]), ca.cos(phi[i])) for i in range(3)]
    joints = [ca.DM.zeros(2), LENGTHS[0] * along[0], LENGTHS[0] * along[0] + LENGTHS[1] * along[1]]
    return [joint + part * line for joint, part, line in zip(joints, CENTRES, along, strict=True)]


def lagrange(phi_now, rates_now, bend_now):
    """d/dt ∂L/∂φ̇ - ∂L/∂φ (3) [N·m] and m·(acceleration - gravity) (3, 2) [N] by CasADi's own derivatives."""
    phi, rates, bend = ca.SX.sym("phi", 3), ca.SX.sym("rates", 3), ca.SX.sym("bend", 3)
    kinetic = 0.5 * ca.dot(ca.DM(INERTIAS), rates**2)
    potential, pushes = 0.0, []
    for m, centre in zip(MASSES, centres(phi), strict=True):
        velocity = ca.jacobian(centre, phi) @ rates
        acceleration = ca.jacobian(velocity, phi) @ rates + ca.jacobian(velocity, rates) @ bend
        kinetic += 0.5 * m * ca.sumsqr(velocity)
        potential += m * GRAVITY * centre[1]
        pushes.append(m * (acceleration + ca.DM([0.0, GRAVITY])))
    impulse = ca.gradient(kinetic, rates)
    forces = (
        ca.jacobian(impulse, phi) @ rates + ca.jacobian(impulse, rates) @ bend - ca.gradient(kinetic - potential, phi)
    )
    found = ca.Function("lagrange", [phi, rates, bend], [forces, ca.horzcat(*pushes).T])(phi_now, rates_now, bend_now)
    return np.array(found[0])[:, 0], np.array(found[1])


def test_motion_follows_lagrange_with_the_virtual_work_of_muscles_and_contact(leg, moment):
    """Q = -Σ F·∂length/∂φ, and contact bends the knee by its moment about the hinge."""
    phi, rates, bend, _, pose, wrench, forces = moment
    hip, knee = squat.HIP_M @ forces, squat.KNEE_M @ forces
    ankle = ANKLE_M @ forces
    by_muscles = np.array([ankle - knee, knee - hip, hip])
    moment_nm = 1e-3 * (wrench[3:] - np.cross(pose[:3], wrench[:3]))[2]
    expected = lagrange(phi, rates, bend)[0] - by_muscles - moment_nm * np.array([1.0, -1.0, 0.0])
    np.testing.assert_allclose(left(leg, moment)[0], expected, atol=1e-9)


def test_muscles_shorten_by_their_arms_times_the_angles(moment):
    phi, rates, _, a, _, _, forces = moment
    arms = np.column_stack([ANKLE_M - squat.KNEE_M, squat.KNEE_M - squat.HIP_M, squat.HIP_M])
    active, passive, _ = rigid_tendon_forces(squat.GROUPS, squat.LENGTH_M - arms @ phi, -arms @ rates)
    np.testing.assert_allclose(forces, a * active + passive, atol=1e-9)


def test_muscles_contact_and_spring_push_thigh_and_trunk(leg, moment):
    phi, rates, bend, _, pose, wrench, forces = moment
    x, y = np.array([-np.cos(phi[0]), np.sin(phi[0])]), np.array([np.sin(phi[0]), np.cos(phi[0])])  # back, up the shank
    lean = np.radians(20.0) * (1.0 - (phi[0] - phi[1]) / np.radians(75.0))
    pull = {"patellar tendon": np.sin(lean) * x - np.cos(lean) * y, "shank": -y, "": np.zeros(2)}
    pull["thigh"] = -np.array([np.sin(phi[1]), np.cos(phi[1])])
    on_femur = sum(pull[row[8]] * f for row, f in zip(MUSCLES.values(), forces, strict=True))
    on_femur = on_femur - wrench[0] * x - wrench[1] * y - 30.0 * pose[0] * x
    off = on_femur - lagrange(phi, rates, bend)[1][1:].sum(axis=0)
    np.testing.assert_allclose(left(leg, moment)[1][:2], [off @ x, off @ y], atol=1e-9)


def test_ground_force_presses_the_medial_side_and_lies_between_heel_and_toe(leg, moment):
    phi, rates, bend, _, pose, wrench, forces = moment
    forward, up = lagrange(phi, rates, bend)[1].sum(axis=0)
    _, across, room = left(leg, moment)
    contact_nmm = wrench[3:] - np.cross(pose[:3], wrench[:3])
    assert -across[2] == pytest.approx(1e-3 * (contact_nmm[0] - BODY.lever_mm * up) - FRONTAL_M @ forces, abs=1e-9)
    centre = -(ANKLE_M @ forces + BODY.ankle_height_m * forward) / up
    np.testing.assert_allclose(room, up * np.array([centre - BODY.heel_m, BODY.toe_m - centre]), atol=1e-9)


def test_a_trade_off_meets_its_constraints_and_no_squat_is_cheaper_at_the_weight_of_another(tmp_path, capsys):
    model = cc.foundation("knee")
    problem = squat.build(model, BODY, intervals=6)
    found = squat.trade_off(problem, [0.01, 0.3])
    nlp = problem.nlp
    values = ca.Function("values", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])
    cost = {(w, of): float(values(x, w)[0]) for w in found for of, x in found.items()}
    assert cost[0.01, 0.01] < cost[0.01, 0.3]
    assert cost[0.3, 0.3] < cost[0.3, 0.01]
    for x in found.values():
        g = np.array(values(x, 0.0)[1])[:, 0]
        assert (g > problem.bounds["lbg"] - 1e-5).all()
        assert (g < problem.bounds["ubg"] + 1e-5).all()
        _, a, poses = (np.asarray(part).T for part in problem.unpack(x))
        flexion = np.radians(10.0 + 35.0 * (1.0 - np.cos(2.0 * np.pi * problem.grid.times_s / 3.0)))
        np.testing.assert_allclose(-poses[:, 5], flexion, atol=1e-6)
        assert a.min() > 0.0099
    effort = problem.grid.weights @ np.mean(np.asarray(problem.unpack(found[0.01])[1]).T ** 2, axis=1)
    assert effort == pytest.approx(0.00539, rel=0.02)  # of 24 intervals


def test_the_program_prints_its_table_and_draws(tmp_path, capsys):
    squat.main(weights="0.1", intervals=6, depth=60.0, out=tmp_path)
    assert "verified" in capsys.readouterr().out
    assert (tmp_path / "squat.png").stat().st_size > 1000
    with pytest.raises(ValueError, match="depth"):
        squat.build(cc.foundation("knee"), BODY, depth_deg=120.0)
