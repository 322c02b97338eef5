"""Problems on scenes that lock or tie pose parameters: they find poses that the joint can take, or say that they
cannot."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, pose_index
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.connections import Contact
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.optimisation.starts import middle_pose
from casadi_contact.scenes.joint_cycle import JointCycle, scene_cycles
from problems import calibration, muscle_contact, muscle_driven, pose_estimation, static_equilibrium
from problems.calibration.measurement import synthetic_measurement
from problems.muscle_contact.extensor import load_extensor
from problems.pose_estimation.completion import solve_and_complete
from problems.pose_estimation.problem import measured_pose, wanted_loads
from tests.support.compiler import needs_compiler
from tests.support.held_scenes import AT_ZERO, LOCKED, SLOPE, held_ball, scene_held

TIE = {"locked": {"tz": 0.3}, "tied": {"ry": {"to": "tx", "slope": 0.01, "at_zero": -0.02}}}


@pytest.fixture(scope="module")
def knee():
    return PolarFoundation(scene_held("knee", TIE), Rays(8, 2))


def cycle(pose, loads):
    frames = len(next(iter(loads.values())))
    return JointCycle("held", np.linspace(0.0, 1.0, frames), pose, loads)


@needs_compiler
def test_pose_estimation_takes_the_planar_knee():
    model = PolarFoundation(cc.load_scene("planar_knee"), Rays(8, 2))
    reference = scene_cycles(model.scene)[0]
    curves = [{name: curve[::25] for name, curve in part.items()} for part in (reference.pose, reference.loads)]
    measured = JointCycle("walk", reference.time_s[::25], *curves)
    problem = pose_estimation.build(model, measured)
    assert problem.free == ("ty",)
    result = pose_estimation.solve(problem)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(model(result.poses, ["Fy"])[:, 0], measured.loads["Fy"], atol=1e-3)
    for name, curve in {**measured.pose, "tz": 0.0, "rx": 0.0, "ry": 0.0}.items():
        np.testing.assert_array_equal(result.poses[:, pose_index(name)], curve)


def test_poses_found_again_lie_on_the_tie():
    """From loads on the rail the poses there come back, on a foundation that would let the ball leave it."""
    model = symbolic(ElasticFoundation(held_ball(), (60, 60)))
    rng = np.random.default_rng(0)
    truth = model.scene.pose_space.onto(np.column_stack([rng.uniform(-1, 1, 3), np.full(3, 29.9), *np.zeros((4, 3))]))
    loads = dict(zip(("Fy", "Fx"), model(truth, ["Fy", "Fx"]).T, strict=True))
    problem = pose_estimation.build(model, cycle({"rz": np.zeros(3)}, loads))
    result = solve_and_complete(problem, None, model)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.poses, truth, atol=1e-4)


def test_what_is_measured_against_the_scene_is_refused_by_name():
    scene, fy = held_ball(), np.array([-300.0, -400.0])
    aside = cycle({"rz": np.zeros(2), "rx": np.array([LOCKED, 0.2])}, {"Fy": fy, "Fx": 0.1 * fy})
    with pytest.raises(ValueError, match=r"cycle held: rx is locked at 0.05 by the scene, given up to 0.15 off that"):
        wanted_loads(scene, aside)
    with pytest.raises(ValueError, match=r"tz is tied to tx by the scene, which is not given"):
        wanted_loads(scene, cycle({"rz": np.zeros(2), "tz": np.zeros(2)}, {"Fy": fy, "Fx": 0.1 * fy}))
    few = cycle({"rz": np.zeros(2)}, {"Fy": fy})
    with pytest.raises(ValueError, match=r"1 loads \(Fy\) cannot tell 2 pose parameters \(tx, ty\)"):
        wanted_loads(scene, few)


def test_measured_values_that_agree_are_taken():
    fy, tx = np.array([-300.0, -400.0]), np.array([0.5, -0.5])
    pose = {"rz": np.zeros(2), "rx": np.full(2, LOCKED), "tx": tx, "tz": AT_ZERO + SLOPE * tx}
    assert measured_pose(held_ball(), cycle(pose, {"Fy": fy})).keys() == {"rz", "tx"}


@needs_compiler
def test_loads_are_in_balance_along_what_the_joint_allows(knee):
    """A virtual move along the tie, tx with 0.01 rad/mm of ry, does no work: neither force alone vanishes."""
    space = knee.scene.pose_space
    free = ("tx", "ty", "rx")
    loads = np.array([[-20.0, -800.0, 0.0, 3000.0, -3000.0, 0.0]])
    rest = space.onto(np.array([0.0, 27.5, 0.0, 0.0, 0.0, -0.3]))
    problem = static_equilibrium.build(knee, loads, free=free, rest=rest)
    result = static_equilibrium.solve(problem)
    assert result.converged.all(), result.reason
    np.testing.assert_allclose(result.poses, space.onto(result.poses), atol=1e-12)
    assert result.poses[0, 5] == -0.3

    def work(move):
        """Of what is left, F·dt + (T - t × F)·dω, about the fixed origin and with the axes of a small ry."""
        left = loads[0] - result.wrenches[0]
        torque = left[3:] - np.cross(result.poses[0, :3], left[:3])
        rx = result.poses[0, 3]
        return left[:3] @ move[:3] + torque @ np.array([move[3], np.cos(rx) * move[4], np.sin(rx) * move[4]])

    along = np.array([1.0, 0.0, 0.0, 0.0, 0.01, 0.0])
    assert work(along) == pytest.approx(0.0, abs=0.01)
    assert abs(work(along * [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])) > 10.0


@needs_compiler
@pytest.mark.parametrize(
    ("model", "free", "loads"),
    [
        (
            lambda: PolarFoundation(whole_wrench(cc.load_scene("planar_knee")), Rays(8, 2)),
            ("tx", "ty"),
            (-60, -1200, 0, 7500),
        ),
        (lambda: CupFoundation(cc.load_scene("hip")), ("tx", "ty", "tz"), (100, 900, -150, 0)),
    ],
    ids=["planar knee", "hip"],
)
def test_joints_pressed_in_one_settle_from_out_of_contact(model, free, loads):
    model = model()
    problem = static_equilibrium.build(model, [*loads, 0.0, 0.0], free=free)
    apart = middle_pose(model) + 0.1 * np.isin(POSE_NAMES, free[-1:])
    assert not model(apart[None]).any()
    result = static_equilibrium.solve(problem, apart[None])
    assert result.converged.all(), result.reason
    held = [pose_index(name) for name in free]
    np.testing.assert_allclose(result.wrenches[0, held], np.array(loads)[held], atol=0.1)


@needs_compiler
@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda knee: static_equilibrium.build(knee, np.ones(6), free=("ty", "ry")), "free: ry is tied to tx"),
        (lambda knee: static_equilibrium.build(knee, np.ones(6), rest=np.zeros(6), free=("ty",)), "rest: tz is locked"),
        (lambda knee: calibration.build(knee, None), "calibration moves all six"),
        (lambda knee: synthetic_measurement(knee, {}), "a made-up measurement moves all six"),
        (lambda knee: muscle_contact.build(knee, example_walk(5)), "a muscle problem moves all six"),
        (lambda knee: muscle_driven.build(knee, None, None), "a knee driven by muscles moves all six"),
        (
            lambda knee: Assembly("joint", "tibia", {"femur": np.zeros(6)}, [Contact("c", knee, "tibia", "femur")]),
            "assembly joint: the contact c moves all six",
        ),
    ],
)
def test_what_moves_all_six_parameters_names_those_that_are_held(knee, build, said):
    with pytest.raises(ValueError, match=said):
        build(knee)


@needs_compiler
@pytest.mark.parametrize("scene", ["planar_knee", "hip", "patellofemoral"])
@pytest.mark.parametrize(
    ("build", "needed"),
    [
        (lambda model: muscle_contact.build(model, example_walk(5)), "Fy_med, Fy_lat, Fx, Fz, Tx, Ty, Tz"),
        (lambda model: muscle_driven.build(model, None, None), "Fy_med, Fy_lat, Fx, Fz, Tx, Ty, Tz"),
        (lambda model: load_extensor("knee_with_patella", model), "Fy_med, Fy_lat, Fx, Fz, Tx, Ty, Tz"),
        (lambda model: synthetic_measurement(model, {}), "Fy_med, Fy_lat"),
    ],
    ids=["muscle_contact", "muscle_driven", "patella", "calibration"],
)
def test_what_needs_a_knee_with_two_sides_names_the_loads_that_it_got_and_wants(scene, build, needed):
    model = cc.foundation(scene)
    got = ", ".join(model.load_names)
    with pytest.raises(ValueError, match=rf"scene {scene} has the loads {got}, expected {needed}: take the scene knee"):
        build(model)


def test_all_names_are_told_apart():
    space = held_ball().pose_space
    assert [space.bound(name) for name in POSE_NAMES] == ["", "", "tied to tx", "locked at 0.05", "locked at 0", ""]


def test_what_a_whole_wrench_adds_may_be_off_as_far_as_the_loads_that_are_wanted():
    """Forces of 1 N allow torques of 1 N at 25 mm."""
    whole = whole_wrench(cc.load_scene("planar_knee"))
    assert set(whole.load_names) == set(WRENCH_NAMES)
    assert [whole.tolerances[name] for name in ("Fz", "Tx", "Ty", "Tz")] == [1.0, 25.0, 25.0, 25.0]
