"""The patella in walking: pulled along by the quadriceps, in equilibrium, from any start; mistakes."""

from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_IN_MM
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.scenes.walking import reference_cycle
from problems import patella
from problems.patella.follow import LEAST_TENSION_N, SAME_N
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


def test_slack_quadriceps_hold_the_patella_as_those_do_that_hardly_pull(ride):
    """A zero is one of a solver, which may lie a little below."""
    femur = ride.poses[:, 0]
    slack, least = (patella.follow(ride.assembly, femur, [300.0, n, 300.0]) for n in (-1e-5, LEAST_TENSION_N))
    assert slack.converged.all()
    np.testing.assert_array_equal(slack.poses, least.poses)


@pytest.mark.parametrize(
    ("tensions", "said"),
    [
        ([300.0, -300.0, 300.0], "the tension of frame 1 is -300 N, expected 0 or more"),
        ([300.0, 300.0, np.nan], "the tension of frame 2 is nan N, expected 0 or more"),
        ([300.0, 300.0], r"tensions have shape \(2,\), expected \(3,\): one \[N\] for each frame"),
    ],
)
def test_tensions_that_no_quadriceps_have_are_named_with_their_frame(ride, tensions, said):
    with pytest.raises(ValueError, match=said):
        patella.follow(ride.assembly, ride.poses[:, 0], tensions)


def test_assemblies_of_other_bodies_or_pulls_are_refused(ride):
    other = Assembly("one", "earth", {"body": np.zeros(6)})
    with pytest.raises(ValueError, match="has the bodies body, expected femur, patella"):
        patella.follow(other, ride.poses[:, 0], TENSION_N)
    pull = ride.assembly.pulls[0]
    pulls = [pull, replace(pull, name="vasti")]
    with pytest.raises(ValueError, match=f"has the pulls {pull.name}, vasti, expected one, the quadriceps"):
        patella.follow(replace(ride.assembly, pulls=pulls), ride.poses[:, 0], TENSION_N)
    with pytest.raises(ValueError, match="has the pulls none, expected one"):
        patella.follow(replace(ride.assembly, pulls=[]), ride.poses[:, 0], TENSION_N)
