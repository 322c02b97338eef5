"""The simulator's energy balance, its rest, and the same motion on elements of the foundation."""

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.optimisation.joint_mechanics import generalised_forces
from problems import knee_simulator


@pytest.fixture(scope="module")
def simulator(knee):
    return knee_simulator.build(knee)


@pytest.fixture(scope="module")
def motion(simulator):
    return knee_simulator.simulate(simulator, knee_simulator.start_state(simulator), tolerance=1e-8)


def test_waveforms_have_the_magnitudes_of_the_standard():
    flexion, axial, ap, ie = (
        np.array([float(v) for v in values])
        for values in zip(*(knee_simulator.walking(s, 1.0) for s in np.linspace(0.0, 1.0, 201)), strict=True)
    )
    assert flexion.min() >= 0.0
    assert flexion.max() == pytest.approx(58.0, abs=1.0)
    assert axial.max() == pytest.approx(2600.0, rel=0.03)
    assert (ap.min(), ap.max()) == pytest.approx((-265.0, 110.0), abs=20.0)
    assert ie.min() == pytest.approx(-6000.0, rel=0.03)


def test_energy_is_accounted_for_and_poses_are_the_known_ones(simulator, motion):
    turnover = np.abs(motion.work[:, 0]).max()
    assert turnover == pytest.approx(389.7, rel=0.01)
    assert np.abs(motion.energy_error(simulator.rig)).max() < 1e-6 * turnover
    golden = {10: [0.751, 27.242, -0.005, 0.0012, 0.0082], 50: [0.011, 27.534, 0.178, -0.0049, -0.0476]}
    for frame, pose in golden.items():
        np.testing.assert_allclose(motion.poses[frame, :5], pose, atol=5e-3)


def test_at_rest_contact_and_springs_balance_the_loads(knee):
    held = (25.0, 900.0, -80.0, -1500.0)  # flexion, then loads
    simulator = knee_simulator.build(knee, lambda share, _: tuple(0.0 * share + value for value in held))
    rest = knee_simulator.start_state(simulator)
    still = knee_simulator.simulate(simulator, rest, cycles=0.5, frames=3, tolerance=1e-8)
    np.testing.assert_allclose(still.states, np.tile(rest, (3, 1)), atol=1e-5)
    pose, wrench = still.poses[-1], still.wrenches[-1]
    assert wrench[1] == pytest.approx(-900.0, abs=0.01)
    assert wrench[0] == pytest.approx(-80.0 - 30.0 * pose[0], abs=0.01)
    torque = np.asarray(generalised_forces(ca.DM(pose), ca.DM(wrench)))[3:, 0]
    assert torque[0] == pytest.approx(5.0 * 900.0, abs=1.0)
    off = rest + np.array([0.5, 0.3, 0.2, 0.004, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved = knee_simulator.simulate(simulator, off, cycles=3.0, frames=4, tolerance=1e-8)
    np.testing.assert_allclose(moved.states[-1], rest, atol=1e-4)


def test_the_program_compares_surrogate_and_elements(tmp_path, capsys):
    knee_simulator.main(cycles=0.02, out=tmp_path)
    assert "foundation" in capsys.readouterr().out
    assert (tmp_path / "knee_simulator.csv").read_text("utf-8").count("\n") == 102
    assert (tmp_path / "knee_simulator.png").stat().st_size > 1000


def test_friction_takes_energy_that_is_accounted_for():
    scene = cc.load_scene("knee", **knee_simulator.rubbing(0.05))
    simulator = knee_simulator.build(cc.PolarFoundation(scene, cc.Rays(8, 2)))
    start = knee_simulator.start_state(simulator)
    motion = knee_simulator.simulate(simulator, start, cycles=0.2, frames=11, tolerance=1e-8)
    assert motion.work[-1, 2] > 300.0  # N·mm, against contact, which stores less than 100
    assert np.abs(motion.energy_error(simulator.rig)).max() < 1e-6 * np.abs(motion.work).max()
