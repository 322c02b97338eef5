"""Forward simulation: rest, energy, convergence, golden poses, and the same motion on the elastic foundation."""

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact import PolarFoundation, Rays
from casadi_contact.optimisation import pose_bounds
from casadi_contact.statics import advance_to_contact, settle
from problems import knee_simulator, static_equilibrium
from problems.knee_simulator import __main__, race
from problems.knee_simulator.balance import EnergyBalance, lifting_energy, unbalanced
from problems.knee_simulator.rig import Rig
from problems.knee_simulator.waveforms import WALKING, Waveforms
from tests.support.command import ended
from tests.support.compiler import needs_compiler
from tests.support.interrupted import Interrupted, interrupts_remembered


@pytest.fixture(scope="module")
def simulator(knee):
    return knee_simulator.build(knee)


@pytest.fixture(scope="module")
def start(simulator):
    return knee_simulator.start_state(simulator)


@pytest.fixture(scope="module")
def motion(simulator, start):
    return knee_simulator.solve(simulator, start, tolerance=1e-9, energies=True)


def largest_difference(a, b):
    off = np.abs(a.poses - b.poses)
    return off[:, :3].max(), np.degrees(off[:, 3:].max())


def test_waveforms_are_periodic_and_of_the_standards_size():
    share = np.linspace(0.0, 1.0, 1001)
    for wave in (WALKING.flexion_deg, WALKING.axial_n, WALKING.ap_n, WALKING.ie_nmm):
        assert wave.at(0.0) == pytest.approx(wave.at(1.0), abs=1e-9)
    assert WALKING.axial_n.at(share).max() == pytest.approx(2600.0, rel=0.03)
    assert WALKING.flexion_deg.at(share).max() == pytest.approx(58.0, rel=0.03)
    assert WALKING.ap_n.at(share).min() == pytest.approx(-265.0, rel=0.03)
    assert WALKING.ie_nmm.at(share).min() == pytest.approx(-6000.0, rel=0.03)


def test_golden_poses_of_the_walking_cycle(motion):
    golden = {
        10: [0.751, 27.242, -0.005, 0.0012, 0.0082],
        50: [0.011, 27.534, 0.178, -0.0049, -0.0476],
        80: [-0.028, 27.265, 0.001, 0.0002, -0.0001],
    }
    for frame, pose in golden.items():
        np.testing.assert_allclose(motion.poses[frame, :5], pose, atol=5e-3)  # by which networks of 0.3 N differ


def test_poses_and_loads_stay_in_the_learned_range(knee, motion):
    low, high = pose_bounds(knee)
    assert ((motion.poses > low) & (motion.poses < high)).all()
    assert knee(motion.poses, ["Fy_lat"]).min() > -885.0  # the samples' largest lateral load in D3


def test_energy_is_accounted_for(simulator, motion):
    balance = EnergyBalance.of(simulator, motion)
    turnover = np.abs(balance.applied + balance.drive).max()
    assert turnover > 100.0
    assert np.abs(balance.error).max() < 1e-6 * turnover
    # The work against contact comes back when contact does: forces of springs along fixed normals nearly derive from
    # an energy, and the surrogate has learned that.
    assert np.abs(balance.unstored).max() < 0.01 * turnover
    assert balance.stored.max() > 50.0
    assert (np.diff(balance.dissipation) >= 0.0).all()


def test_the_stored_energy_is_the_elastic_foundations(knee, motion):
    poses = motion.poses[::20]
    foundation = cc.ElasticFoundation(knee.scene, (80, 40))
    np.testing.assert_allclose(lifting_energy(knee, poses), lifting_energy(foundation, poses), rtol=0.02, atol=0.05)


@dataclass
class SpringWithFalseLoad:
    """Pushes by k·depth below ty = 0, and again, falsely, from a gap of its own on."""

    stiffness: float
    gap_mm: float
    patch_names = ("contact",)
    load_names = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")

    def __call__(self, poses):
        height = poses[:, 1]
        loads = np.zeros((len(poses), 6))
        loads[:, 1] = np.where(height < 0.0, self.stiffness * height, np.where(height > self.gap_mm, -70.0, 0.0))
        return loads


@pytest.mark.parametrize("gap_mm", [0.1, 0.9, 50.0])
def test_what_pushes_beyond_the_first_gap_stores_nothing(gap_mm):
    """½k·d² of a spring, also where it is lifted by more than a millimetre."""
    depths_mm = np.array([0.0, 0.3, 0.5, 2.5])
    poses = np.zeros((4, 6))
    poses[:, 1] = -depths_mm
    stored = lifting_energy(SpringWithFalseLoad(200.0, gap_mm), poses)
    np.testing.assert_allclose(stored, 100.0 * depths_mm**2, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("modulus", [5.0, 500.0])
def test_what_contact_stores_grows_by_its_force_in_soft_layers_too(modulus):
    """dU/dty = -N, 1.5 mm deep in a layer like cartilage."""
    scene = cc.load_scene("knee", youngs_modulus=modulus)
    model, names = cc.foundation(scene), ("Fy_med", "Fy_lat")
    targets = dict.fromkeys(names, np.array([-900.0]))
    begin = advance_to_contact(model, np.array(scene.start_pose)[None], targets)
    poses, report = settle(model, begin, ("ty", "rx"), targets)
    assert report.converged.all()
    step = np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0])
    slope = (lifting_energy(model, poses + step) - lifting_energy(model, poses - step)) / 2e-3
    assert slope == pytest.approx(model(poses, names).sum(axis=1), rel=1e-3)


def test_at_rest_it_stays_at_rest(knee):
    held = knee_simulator.build(knee, Waveforms.constant(25.0, 900.0, -80.0, -1500.0))
    still = knee_simulator.solve(held, cycles=0.5, frames=6, tolerance=1e-8)
    np.testing.assert_allclose(still.states, np.tile(still.states[0], (6, 1)), atol=1e-5)
    # and what it rests on is the static equilibrium's wrench: applied loads less the springs
    rest = static_equilibrium.build(
        knee,
        np.asarray(held.applied(0.0)).T,
        rest=[0.0, 0.0, 0.0, 0.0, 0.0, -np.radians(25.0)],
        stiffness=np.append(held.rig.stiffness, 0.0),
        about="moving",
    )
    np.testing.assert_allclose(static_equilibrium.solve(rest).poses[0], still.poses[-1], atol=1e-5)


def test_damped_motion_comes_to_rest_in_the_static_equilibrium(knee):
    held = knee_simulator.build(knee, Waveforms.constant(25.0, 900.0))
    rest = knee_simulator.start_state(held)
    off = rest + np.array([0.5, 0.3, 0.2, 0.004, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved = knee_simulator.solve(held, off, cycles=3.0, frames=4, tolerance=1e-8)
    np.testing.assert_allclose(moved.states[-1], rest, atol=1e-4)


def test_error_falls_with_the_tolerance_and_idas_agrees(simulator, start, motion):
    errors = [
        max(largest_difference(knee_simulator.solve(simulator, start, tolerance=tolerance), motion))
        for tolerance in (1e-3, 1e-5, 1e-7)
    ]
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]
    assert errors[2] < 1e-4
    by_idas = knee_simulator.solve(simulator, start, integrator="idas", tolerance=1e-7)
    assert max(largest_difference(by_idas, motion)) < 1e-3


def test_the_elastic_foundation_moves_alike_on_the_same_integrator(knee, simulator, start):
    foundation = cc.ElasticFoundation(knee.scene, (80, 40))
    on_foundation = knee_simulator.solve(knee_simulator.build(foundation), start, cycles=0.6, frames=31, tolerance=1e-4)
    on_surrogate = knee_simulator.solve(simulator, start, cycles=0.6, frames=31, tolerance=1e-4)
    mm, deg = largest_difference(on_surrogate, on_foundation)
    assert mm < 0.02
    assert deg < 0.02
    left = unbalanced(on_surrogate, foundation)
    assert np.abs(left[:, :3]).max() < 10.0


def test_a_lighter_load_presses_less(knee, motion):
    lighter = knee_simulator.build(knee, WALKING.with_loads_scaled(0.4))
    half = knee_simulator.solve(lighter, frames=21, tolerance=1e-5)
    ratio = half.wrenches[:, 1].min() / motion.wrenches[:, 1].min()
    assert ratio == pytest.approx(0.5, abs=0.02)


def test_wrong_requests_are_refused(knee, simulator):
    with pytest.raises(ValueError, match="integrator is 'euler', expected one of cvodes, idas"):
        knee_simulator.solve(simulator, integrator="euler")
    with pytest.raises(ValueError, match="start has shape"):
        knee_simulator.solve(simulator, np.zeros(6))
    for mass_kg in (0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="mass_kg"):
            Rig(mass_kg=(1.0, mass_kg, 1.0))
    for scale in (-1.0, np.inf):
        with pytest.raises(ValueError, match=f"load scale is {scale}"):
            WALKING.with_loads_scaled(scale)
    with pytest.raises(ValueError, match="cycles inf"):
        knee_simulator.solve(simulator, cycles=np.inf)
    with pytest.raises(ValueError, match="no equilibrium to start from"):
        knee_simulator.start_state(knee_simulator.build(knee, Waveforms.constant(20.0, -500.0)))
    foundation = knee_simulator.build(cc.ElasticFoundation(knee.scene, (40, 30)))
    with pytest.raises(ValueError, match="a start is sought on a surrogate"):
        knee_simulator.solve(foundation)
    short = knee_simulator.solve(simulator, cycles=0.01, frames=2)
    with pytest.raises(ValueError, match="energies=True"):
        EnergyBalance.of(simulator, short)


@needs_compiler
def test_a_ball_carries_the_axial_force_above_its_centre_alone():
    """Beside it the force turns the ball, which a dish does not hold."""
    ball = PolarFoundation(cc.load_scene("sphere_in_dish"), Rays(12, 3))
    with pytest.raises(ValueError, match=r"nothing holds rx .* 5 mm medially .* axial_offset_mm=0, or a start"):
        knee_simulator.start_state(knee_simulator.build(ball))
    above = knee_simulator.build(ball, Waveforms.constant(20.0, 500.0, -50.0), Rig(axial_offset_mm=0.0))
    still = knee_simulator.solve(above, cycles=0.2, frames=3, tolerance=1e-8)
    np.testing.assert_allclose(still.states, np.tile(still.states[0], (3, 1)), atol=1e-5)
    assert still.wrenches[-1, 1] == pytest.approx(-500.0, rel=1e-3)


def test_ctrl_c_in_the_integrator_is_not_the_users_mistake(simulator, start, monkeypatch):
    """CasADi makes the same error of it as of loads that the joint does not carry."""
    for error, told in ((ArithmeticError("no rate"), ValueError), (KeyboardInterrupt, KeyboardInterrupt)):
        rate = Interrupted(error, (10, 1), 10)
        with interrupts_remembered(monkeypatch), pytest.raises(told):
            knee_simulator.solve(replace(simulator, rate=rate), start)


def test_times_of_a_race_are_medians_without_the_run_that_warms_up(simulator, monkeypatch):
    seconds = iter([100.0] * 3 + [1.0, 2.0, 3.0] + [5.0, 6.0, 7.0] + [9.0, 10.0, 11.0] + [0.0])
    monkeypatch.setattr(race, "foundations", lambda _: [])
    monkeypatch.setattr(race, "start_state", lambda _: None)
    monkeypatch.setattr(race, "solve", lambda *_, **__: SimpleNamespace(seconds=next(seconds), poses=np.zeros((2, 6))))
    runs = race.race(simulator, cycles=2.0, repeats=3)
    period_s = simulator.rig.period_s
    assert [run.seconds_per_second for run in runs] == [5.0 / (2.0 * period_s), 3.0 / period_s, 7.0 / (2.0 * period_s)]


def test_the_command_races_and_writes_csv_summary_and_picture(tmp_path, monkeypatch):
    assert ended(monkeypatch, __main__.main, "--out", tmp_path, "--cycles", 0.02, "--repeats", 1) == 0
    summary = json.loads((tmp_path / "knee_simulator.json").read_text("utf-8"))
    assert {run["model"] for run in summary["runs"]} == {"surrogate", "EF 80×40", "EF 160×80"}
    assert all(run["off_mm"] < 0.02 for run in summary["runs"])
    assert (tmp_path / "knee_simulator.csv").read_text("utf-8").count("\n") == 102
    assert (tmp_path / "knee_simulator.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--surrogate", "hip"), "unknown surrogate 'hip'"),
        (("--integrator", "euler"), "integrator is 'euler'"),
        (("--load-scale", "0"), "load scale is 0.0"),
        (("--scene", "hip"), "scene hip is pressed along |F|"),
    ],
)
def test_a_mistake_is_one_line(arguments, said, tmp_path, monkeypatch):
    code = ended(monkeypatch, __main__.main, "--out", tmp_path, *arguments)
    assert code.startswith("knee_simulator: ")
    assert said in code
    assert "\n" not in code
