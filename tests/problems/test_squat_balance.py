"""What crosses the knee and the foot, by a free body drawn in the world's axes, and which way a fibre's speed acts."""

import numpy as np
import pytest

from problems import squat
from problems.knee_simulator.rig import Rig
from problems.squat.leg import GRAVITY
from problems.squat.muscles import MUSCLES, column

BODY = squat.Body()
STEP_S = 1e-4


@pytest.fixture(scope="module")
def mechanics():
    return squat.LegMechanics.of(BODY)


@pytest.fixture(params=range(5))
def moment(request, mechanics):
    """φ, φ̇, φ̈, activations and muscle forces of some moment."""
    draw = np.random.default_rng(request.param)
    phi, rate, bend = draw.uniform(-0.8, 0.8, 3), draw.uniform(-2.0, 2.0, 3), draw.uniform(-5.0, 5.0, 3)
    a = draw.uniform(0.0, 1.0, len(MUSCLES))
    return phi, rate, bend, a, np.array(mechanics.muscle_forces(phi, rate, a))[:, 0]


@pytest.fixture
def wrench():
    """Of contact on the insert, at its origin [N, N·mm]."""
    return np.array([120.0, -900.0, 35.0, 8000.0, -600.0, 4000.0])


def residuals(mechanics, moment, pose, wrench):
    phi, rate, bend, a, _ = moment
    return [np.array(part)[:, 0] for part in mechanics.residuals(phi, rate, bend, a, pose, wrench)]


def pose_of(phi):
    return np.array([3.0, 27.0, 0.0, 0.0, 0.0, phi[1] - phi[0]])


def centres(phi):
    """Centres of mass (3, 2), forward and up from the ankle [m]."""
    along = np.column_stack([np.sin(phi), np.cos(phi)])
    joints = np.vstack([[0.0, 0.0], np.cumsum(BODY.lengths_m[:2, None] * along[:2], axis=0)])
    return joints + BODY.centres_m[:, None] * along


def pushes(moment):
    """Mass times (acceleration - gravity) of each segment (3, 2) [N], by differences of where its centre is."""
    phi, rate, bend, *_ = moment
    before, at, after = (centres(phi + rate * t + 0.5 * bend * t**2) for t in (-STEP_S, 0.0, STEP_S))
    return BODY.masses_kg[:, None] * ((before - 2.0 * at + after) / STEP_S**2 + [0.0, GRAVITY])


def test_what_pushes_thigh_and_trunk_is_muscles_contact_and_the_spring(mechanics, moment, wrench):
    phi, *_, forces = moment
    pose = pose_of(phi)
    x, y = np.array([-np.cos(phi[0]), np.sin(phi[0])]), np.array([np.sin(phi[0]), np.cos(phi[0])])  # back, up the shank
    lean = np.radians(20.0) * (1.0 - (phi[0] - phi[1]) / np.radians(75.0))
    pull = {
        "quadriceps": np.sin(lean) * x - np.cos(lean) * y,  # forward on the tibia, so backward on the femur
        "thigh": -np.array([np.sin(phi[1]), np.cos(phi[1])]),
        "shank": -y,
    }
    on_femur = sum(pull[m.along] * f for m, f in zip(MUSCLES.values(), forces, strict=True) if m.along)
    on_femur = on_femur - wrench[0] * x - wrench[1] * y - Rig().ap_spring_n_per_mm * pose[0] * x
    left = on_femur - pushes(moment)[1:].sum(axis=0)
    across = residuals(mechanics, moment, pose, wrench)[1]
    np.testing.assert_allclose(across[:2], [left @ x, left @ y], atol=1e-2)


def test_a_ground_force_medial_of_the_knee_presses_its_medial_side(mechanics, moment, wrench):
    """Moments about x on the tibia at the femur's origin: contact, muscles, and the ground's force times its lever."""
    pose = pose_of(moment[0])
    contact_nmm = wrench[3:] - np.cross(pose[:3], wrench[:3])
    up = pushes(moment)[:, 1].sum()
    on_tibia = 1e-3 * (contact_nmm[0] - BODY.adduction_lever_mm * up) - column("frontal_m") @ moment[4]
    assert -residuals(mechanics, moment, pose, wrench)[1][2] == pytest.approx(on_tibia, abs=1e-3)


def test_contact_bends_the_knee_by_its_moment_about_the_hinge(mechanics, moment, wrench):
    pose = pose_of(moment[0])
    contact_nmm = wrench[3:] - np.cross(pose[:3], wrench[:3])
    pressed, free = (residuals(mechanics, moment, pose, on)[0] for on in (wrench, np.zeros(6)))
    np.testing.assert_allclose(pressed - free, 1e-3 * contact_nmm[2] * np.array([-1.0, 1.0, 0.0]), atol=1e-9)


def test_the_foot_is_in_balance_about_the_ankle_between_heel_and_toe(mechanics, moment, wrench):
    forward, up = pushes(moment).sum(axis=0)
    _, _, ground, within = residuals(mechanics, moment, pose_of(moment[0]), wrench)
    np.testing.assert_allclose(ground, [forward, up], atol=1e-2)
    centre = -(column("ankle_m") @ moment[4] + BODY.ankle_height_m * forward) / up
    np.testing.assert_allclose(within, up * np.array([centre - BODY.heel_m, BODY.toe_m - centre]), rtol=1e-4, atol=1e-2)


def test_a_muscle_that_lengthens_is_stronger_than_one_that_shortens(mechanics):
    vasti, a = list(MUSCLES).index("vasti"), np.full(len(MUSCLES), 0.5)
    bending, extending = (float(mechanics.muscle_forces([0.4, -0.6, 0.5], [r, -r, 0.0], a)[vasti]) for r in (0.5, -0.5))
    assert bending > 1.1 * extending
