"""The patella in walking: pulled along by the quadriceps, in equilibrium, from any start; mistakes."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.assembly import Assembly
from casadi_contact.conventions import POSE_IN_MM
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.optimisation import shear_free_poses
from problems import patella
from problems.muscle_contact.example import example_walk
from problems.patella import __main__
from problems.patella.follow import SAME_N
from tests.support.command import ended
from tests.support.compiler import needs_compiler

pytestmark = needs_compiler
TENSION_N = np.array([150.0, 500.0, 300.0])


@pytest.fixture(scope="module")
def ride():
    cycle = reference_cycle(frames=101)
    frames = [5, 15, 70]  # of flexion from 5 to 64 degrees
    knee = cc.load_assembly("knee_with_patella")
    femur = shear_free_poses(knee.contacts[0].model, cycle.ry[frames], cycle.rz[frames])
    return patella.follow(knee, femur, TENSION_N)


def load(ride, name):
    return ride.loads[:, ride.assembly.load_names.index(name)]


def test_the_patella_is_in_equilibrium_in_every_frame_and_the_contact_model_agrees(ride):
    assert ride.converged.all(), ride.residual_n
    forces = ride.assembly.forces()
    for poses, tension in zip(ride.poses, TENSION_N, strict=True):
        np.testing.assert_allclose(np.asarray(forces(poses.T, tension))[:, 1] / POSE_IN_MM, 0.0, atol=1e-3)
    assert ride.verdict("patellofemoral").exit_code == 0


def test_contact_carries_what_tendon_and_quadriceps_leave(ride):
    """Straight they nearly cancel; the more the knee bends, the more of the pull presses the patella."""
    pressed = load(ride, "patellofemoral_Fx_med") + load(ride, "patellofemoral_Fx_lat")
    share = np.hypot(pressed, load(ride, "patellofemoral_Fy")) / TENSION_N
    assert share[0] < share[2]
    assert share[1] < share[2]
    tendon = load(ride, "patellar_tendon") / TENSION_N
    np.testing.assert_allclose(tendon[:2], 1.0, atol=0.05)
    assert 0.5 < tendon[2] < 0.8


def test_random_starts_end_where_the_neighbours_led(ride):
    for seed in range(2):
        begin = patella.start_poses(ride, np.random.default_rng(seed))
        again = patella.follow(ride.assembly, ride.poses[:, 0], TENSION_N, begin)
        assert again.converged.all()
        assert ride.loads_apart_n(again).max() < SAME_N
        off = np.abs((again.poses[:, 1] - ride.poses[:, 1]) * POSE_IN_MM).max(axis=1)
        assert off[load(ride, "patellofemoral_Fx_lat") > 1.0].max() < 0.01, "pressed, it has one place"


def test_slack_quadriceps_and_other_assemblies_are_refused(ride):
    with pytest.raises(ValueError, match="expected a positive one for each of 3 frames"):
        patella.follow(ride.assembly, ride.poses[:, 0], 0.0 * TENSION_N)
    other = Assembly("one", "earth", {"body": np.zeros(6)})
    with pytest.raises(ValueError, match="has the bodies body, expected femur, patella"):
        patella.follow(other, ride.poses[:, 0], TENSION_N)


def test_a_patella_that_balances_on_a_walk_that_muscles_do_not_is_no_solution(tmp_path, monkeypatch, capsys):
    """Extending by 600 N·m is beyond any quadriceps; the patella balances whatever pull there is."""
    walk = example_walk(3)
    loads = {**walk.loads, "knee_flexion": walk.loads["knee_flexion"] + 600.0}
    monkeypatch.setattr(__main__, "given_walk", lambda *_: replace(walk, loads=loads))
    assert ended(monkeypatch, __main__.main, "--out", tmp_path) == 2
    said = capsys.readouterr()
    assert "muscles and femur: 0 of 3 solved" in said.out
    assert "patella: not solved: frames 0 to 2" in said.err
